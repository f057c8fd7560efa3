"""Start the ranging node: ``ros2 launch mantaray_ros ranging.launch.py vehicles:="[A, B]"``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from mantaray_ros.parameters import PARAMETERS

ARGUMENTS = PARAMETERS | {"use_sim_time": (True, "Use the simulator's clock.")}


def generate_launch_description():
    """Declare the arguments and start the node with them."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=str(value), description=meaning)
                for name, (value, meaning) in ARGUMENTS.items()
            ),
            Node(
                package="mantaray_ros",
                executable="ranging",
                parameters=[{name: LaunchConfiguration(name) for name in ARGUMENTS}],
                output="screen",
            ),
        ]
    )
