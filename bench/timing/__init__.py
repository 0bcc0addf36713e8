"""How long the daemon takes: ticks, stops, restarts, on a busy machine."""
