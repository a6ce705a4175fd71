"""From a measured master curve or relaxation curve to the Prony series of a configuration."""
