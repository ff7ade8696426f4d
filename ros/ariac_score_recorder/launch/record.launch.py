"""The recorder's node of ROS 2, on simulated time."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    """What ros2 launch starts."""
    names = ("plan", "out", "key")
    arguments = [
        DeclareLaunchArgument(name, **({} if name == "plan" else {"default_value": ""})) for name in names
    ]
    given = [word for name in names for word in ("--" + name, LaunchConfiguration(name))]
    node = Node(
        package="ariac_score_recorder",
        executable="recorder",
        output="screen",
        arguments=given,
        parameters=[{"use_sim_time": True}],
        sigterm_timeout="20",
    )
    return LaunchDescription([*arguments, node])
