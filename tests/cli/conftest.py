"""The command line in the process of the tests."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from subprocess import CompletedProcess

import pytest

from gfmdlayer.cli import main
from gfmdlayer.execution.interrupts import STOP_SIGNALS

Command = Callable[..., CompletedProcess[str]]


@pytest.fixture(scope="session")
def gfmdlayer() -> Iterator[Command]:
    """Run the command line in this process, which starts no Python; return exit status, output and errors."""

    def run(*arguments: str) -> CompletedProcess[str]:
        environment = dict(os.environ)
        with redirect_stdout(StringIO()) as output, redirect_stderr(StringIO()) as errors:
            try:
                status = main(arguments)
            except SystemExit as end:
                status = int(end.code or 0)
            finally:
                os.environ.clear()
                os.environ.update(environment)
        return CompletedProcess(arguments, status, output.getvalue(), errors.getvalue())

    handlers = {signum: signal.getsignal(signum) for signum in STOP_SIGNALS}
    yield run
    for signum, handler in handlers.items():
        signal.signal(signum, handler)
