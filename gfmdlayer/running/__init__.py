"""A run: who computes which case, into which folder, watched and stopped by whom."""
