"""Actions, safety limits, arbitration and the controller: pure, driven by `step(now_s, ...)`."""
