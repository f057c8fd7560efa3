"""Start the ranging node: ``ros2 launch mantaray_ros ranging.launch.py vehicles:="[A, B]"``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    "vehicles": ("[A, B, C]", "Names of the vehicles."),
    "ocean": ("['synthetic:beaufort']", "Ocean files, a cast, a synthetic ocean or a TOML file."),
    "slot": ("0.0", "Interval after which the next vehicle pings; 0: none by itself. [s]"),
    "time_origin": ("0.0", "Stamp at which the ocean begins, if it varies. [s]"),
    "use_sim_time": ("true", "Use the simulator's clock."),
}


def generate_launch_description():
    """Declare the arguments and start the node with them."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=words)
                for name, (value, words) in ARGUMENTS.items()
            ),
            Node(
                package="mantaray_ros",
                executable="ranging",
                parameters=[{name: LaunchConfiguration(name) for name in ARGUMENTS}],
                output="screen",
            ),
        ]
    )
