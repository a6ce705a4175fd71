"""Small studies that tests of several rooms run."""

TINY = """\
name: tiny
grid: {points: 32}
time: {end: 0.03, step: 0.01}
trajectory: {ramp_time: 0.03}
"""
# Files of others in a results folder, with names that are almost those of a run.
OTHERS = (
    *("my_analysis.h5", "0000-copy.h5", "notes.failed", "x.aside", "00001.h5", "0001.h5.bak", "run.running"),
    *("thesis.part", "notes.running", "backup-2024-deadbeef.part", "12.checkpoint", "old.journal"),
    "old.journal0",
)
