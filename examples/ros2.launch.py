"""Four robots behind guards: `ros2 launch examples/ros2.launch.py folder:=DIR`, which has robot-1.yaml and so on.

Each is what `phalanx robot ros2` runs. Planners of namespace r1 … publish cmd_vel_raw, bases hear cmd_vel.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

APART_M, NORTH = 8.0, 1.5707963


def generate_launch_description():
    folder = LaunchConfiguration("folder")
    guards = []
    for robot in range(1, 5):
        place = f"odom_in_map:=[{APART_M * (robot - 1)}, 0.0, {NORTH}]"
        words = ["--namespace", f"r{robot}", "--", "--ros-args", "-p", place]
        file = [folder, f"/robot-{robot}.yaml"]
        guards.append(ExecuteProcess(cmd=["phalanx", "robot", "ros2", file, *words], output="screen"))
    return LaunchDescription([DeclareLaunchArgument("folder"), *guards])
