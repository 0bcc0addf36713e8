"""Conversions between the jaws' units and the motor's, under the vendor SDK's name."""


class UnitConversion:
    """Newtons at the jaws and newton metres at the motor; millimetres and radians."""

    N_TO_NM = 0.1
    """N·m per N (the vendor's figure): approximate, since the force depends on the fingers."""

    NM_TO_N = 10.0
    """N per N·m."""

    RAD_TO_MM = 74.8
    """mm of opening per radian of a gripper as the vendor sells it; calibrated ones differ."""

    MM_TO_RAD = 1.0 / RAD_TO_MM

    @classmethod
    def n_to_nm(cls, force_n: float) -> float:
        """Return the motor's torque for a squeezing force."""
        return force_n * cls.N_TO_NM

    @classmethod
    def nm_to_n(cls, torque_nm: float) -> float:
        """Return the squeezing force of a closing torque."""
        return torque_nm / cls.N_TO_NM

    @staticmethod
    def mm_to_rad(distance_mm: float, rad_to_mm: float) -> float:
        """Return how far the motor turns for a distance of the jaws, without direction."""
        return distance_mm / rad_to_mm

    @staticmethod
    def rad_to_mm(angle_rad: float, rad_to_mm: float) -> float:
        """Return how far the jaws move when the motor turns, without direction."""
        return angle_rad * rad_to_mm
