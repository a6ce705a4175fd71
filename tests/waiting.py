"""Waiting for another process, as long as it lives."""

import time
from pathlib import Path

SLOWLY = str(Path(__file__).with_name("slowly.py"))  # the command line with steps that take 50 ms


def until(reached, process=None):
    """Wait up to two minutes; a process that ends before fails the test with what it printed."""
    end = time.monotonic() + 120
    while not reached():
        assert process is None or process.poll() is None, process and process.communicate()
        assert time.monotonic() < end
        time.sleep(0.01)
