"""The monitor's node of ROS 2."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    """What ros2 launch starts."""
    arguments = [DeclareLaunchArgument("plan"), DeclareLaunchArgument("out", default_value=".")]
    given = [word for name in ("plan", "out") for word in ("--" + name, LaunchConfiguration(name))]
    node = Node(
        package="ariac_score_monitor",
        executable="monitor",
        output="screen",
        arguments=given,
        respawn=True,
    )
    return LaunchDescription([*arguments, node])
