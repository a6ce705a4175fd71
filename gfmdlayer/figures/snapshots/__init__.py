"""Pictures and movies of the fields at the times of the snapshots."""
