"""One gripper: ros2 launch litegrip_ros2 gripper.launch.py channel:=can0 namespace:=left."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "channel": ("", str, "the daemon's channel; empty: LITEGRIP_CHANNEL, else can0"),
    "rate_hz": ("50.0", float, "joint states a second, 0.1 to 200"),
    "joint_layout": ("opening", str, "opening: one joint; slides: the two of the vendor's URDF"),
    "autostart": ("true", bool, "configure and activate the node at once"),
    "enable_on_activate": ("false", bool, "enable the motor as soon as the node is active"),
    "allow_stalling": ("false", bool, "a move that something blocks succeeds"),
}


def generate_launch_description() -> LaunchDescription:
    """Describe the node, and an argument for each parameter that is often set."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=what)
        for name, (default, _, what) in ARGUMENTS.items()
    ]
    parameters = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, (_, kind, _) in ARGUMENTS.items()
    }
    node = LifecycleNode(
        package="litegrip_ros2",
        executable="litegrip_node",
        name=LaunchConfiguration("name"),
        namespace=LaunchConfiguration("namespace"),
        parameters=[parameters],
        output="screen",
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="of the node"),
            DeclareLaunchArgument("name", default_value="gripper", description="of the node"),
            *declared,
            node,
        ]
    )
