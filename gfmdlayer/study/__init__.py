"""Running cases: processes and their work, results folders, checkpoints, progress."""

CHECKPOINT_EVERY = 60.0  # seconds between two checkpoints of a case
