"""The body: materials, the elastic layered halfspace, its relaxation spectrum."""
