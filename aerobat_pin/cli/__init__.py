"""The command line `aerobat`: parse the arguments, call the package, print the results, and set the exit code."""

__all__ = ["main"]


def main() -> None:
    """Run the command line as a program, which signals end as `aerobat_pin.errors` says, from its first moment on."""
    try:
        import gc
        import os
        import signal
        import sys

        from aerobat_pin.cli.spoken_progress import voice
        from aerobat_pin.cli.surroundings import prepare_surroundings
        from aerobat_pin.errors import end_on_signals

        end_on_signals()
        prepare_surroundings()
    except KeyboardInterrupt:
        print("interrupted: nothing was written", file=__import__("sys").stderr)
        raise SystemExit(130) from None
    # Libraries load these wherever they are installed, though nothing here uses them: xarray dask, a second's work,
    # numba coverage, our own room `control` gymnasium.
    on_cluster = any(argument.startswith("--cluster") for argument in sys.argv)
    for name in ("coverage", "gymnasium", *(() if on_cluster else ("dask",))):
        sys.modules.setdefault(name, None)  # type: ignore[arg-type]  # Python's way of saying "not installed"
    # pydantic asks every installed package whether it is a plugin of pydantic: a twentieth of a second.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    gc.set_threshold(200_000)  # a tenth of a start is spent looking for garbage among what was just imported
    with voice.speaking():
        from aerobat_pin.cli import app  # only now, because this takes a tenth of a second

        try:
            app.main()
        finally:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # everything is written and said
