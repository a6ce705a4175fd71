"""What a step reports: effort, contact statistics, friction, energy balance, steady state."""
