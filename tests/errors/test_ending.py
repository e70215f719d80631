"""Loops until a signal comes, as `play` and `node` run them."""

import signal
from contextlib import nullcontext, suppress

import pytest

from aerobat_pin.errors import end_on_signals, until_signal
from aerobat_pin.errors.ending import SIGNALS


@pytest.mark.parametrize("lost", [False, True], ids=["raised", "lost in a callback"])
def test_a_loop_ends_by_the_first_signal(lost: bool) -> None:
    """Also where a library has swallowed the exception, as asyncio and ctypes do in their callbacks."""
    handlers = {number: signal.getsignal(number) for number in (*SIGNALS, signal.SIGPIPE)}
    turns: list[int] = []

    def turn() -> None:
        turns.append(len(turns))
        assert len(turns) < 4
        if len(turns) == 3:
            with suppress(KeyboardInterrupt) if lost else nullcontext():
                signal.raise_signal(signal.SIGINT)

    try:
        end_on_signals()
        until_signal(turn)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert turns == [0, 1, 2]
