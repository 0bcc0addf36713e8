"""Actions, safety limits, arbitration and the engine: pure, driven by `step(now_s, ...)`."""
