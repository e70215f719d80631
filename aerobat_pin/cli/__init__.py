"""The command line `aerobat`: parse the arguments, call the package, print the results, and set the exit code."""

__all__ = ["main"]


def main() -> None:
    """Run the command line as a program, which signals end as `aerobat_pin.files` says, from its first moment on."""
    try:
        import signal

        from aerobat_pin.files import end_on_signals

        end_on_signals()
    except KeyboardInterrupt:
        print("interrupted: nothing was written", file=__import__("sys").stderr)
        raise SystemExit(130) from None
    from aerobat_pin.cli import app  # only now, because this takes a tenth of a second

    try:
        app.main()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # everything is written and said
