"""Ctrl-C and SIGTERM at the command line."""

import os
import signal

import pytest
import typer
from table import each_row

from vastflow.flows.terminal.ending import Interruptible


@each_row("number", [signal.SIGINT, signal.SIGTERM])
def test_last_words_are_said_once_and_the_exit_code_is_130(number):
    said = []
    with pytest.raises(typer.Exit) as ended, Interruptible("bye") as interruptible:
        interruptible.last_words_by(said.append)
        os.kill(os.getpid(), number)
    assert (ended.value.exit_code, said) == (130, ["bye"])


def test_what_an_interrupted_import_raises_is_an_interrupt_too(capsys):
    with pytest.raises(typer.Exit) as ended, Interruptible("bye"):
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            raise SystemError("an extension module was interrupted half-way") from None
    assert ended.value.exit_code == 130
    assert capsys.readouterr().err == "bye\n"


def test_error_without_an_interrupt_stays_what_it_is():
    with pytest.raises(ValueError, match="mine"), Interruptible("bye"):
        raise ValueError("mine")


def test_handlers_are_given_back():
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with Interruptible("bye"):
        assert signal.getsignal(signal.SIGINT) is not before[0]
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
