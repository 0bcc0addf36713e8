"""What the machine says of a CAN link, and which of its managers sets it; the daemon asks, too."""
