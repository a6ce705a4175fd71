"""A study: a folder of cases, those that are missing, claimed, computed, written; see `study/run.py`."""

CHECKPOINT_EVERY = 60.0  # seconds between two checkpoints of a case
