"""Pictures of results: curves, maps, snapshots and movies."""
