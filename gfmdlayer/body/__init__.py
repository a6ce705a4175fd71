"""What the body is: materials, the elastic layered halfspace, its relaxation spectrum."""
