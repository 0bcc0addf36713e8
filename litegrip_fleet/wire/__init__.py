"""What gateway and portal say to each other, and the zenoh session that carries it."""
