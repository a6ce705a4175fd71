"""A run: who computes which case, into which folder, watched and stopped by whom."""

CHECKPOINT_EVERY = 60.0  # seconds after which the state of a case is kept
