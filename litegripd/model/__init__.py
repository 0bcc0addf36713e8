"""Units, geometry, calibration, state, results and errors: values that every room shares."""
