"""The CAN bus: one shape for adapters read here and for those driven by a process of their own."""
