"""What goes wrong on purpose: the matrix of faults, and chaos."""
