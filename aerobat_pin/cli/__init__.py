"""The command line `aerobat`: parse the arguments, call the package, print the results, and set the exit code."""

__all__ = ["main"]


def main() -> None:
    """Run the command line as a program, which signals end as `aerobat_pin.errors` says, from its first moment on."""
    try:
        import gc
        import signal
        import sys

        from aerobat_pin.errors import end_on_signals

        end_on_signals()
    except KeyboardInterrupt:
        print("interrupted: nothing was written", file=__import__("sys").stderr)
        raise SystemExit(130) from None
    if not any(argument.startswith("--cluster") for argument in sys.argv):
        # xarray loads dask, a second's work, wherever it is installed; only a sweep on a cluster has a use for it.
        sys.modules.setdefault("dask", None)  # type: ignore[arg-type]  # Python's way of saying "not installed"
    gc.set_threshold(20_000)  # a tenth of a start is spent looking for garbage among what was just imported
    from aerobat_pin.cli import app  # only now, because this takes a tenth of a second

    try:
        app.main()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # everything is written and said
