"""The package, as colcon builds it (ament_python); pip installs it as well."""

from setuptools import setup

NAME = "litegrip_ros2"

setup(
    name=NAME,
    version="0.1.0",
    description="A LiteGrip gripper in ROS 2, through litegripd",
    license="Apache-2.0",
    packages=[NAME],
    package_data={NAME: ["py.typed"]},
    python_requires=">=3.10",
    install_requires=["litegrip-client>=0.1.0"],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/gripper.launch.py"]),
        (f"share/{NAME}/urdf", ["urdf/litegrip.ros2_control.xacro"]),
    ],
    entry_points={"console_scripts": ["litegrip_node = litegrip_ros2.node:main"]},
)
