"""Package of ROS 2; `colcon build` runs it."""

from setuptools import setup

NAME = "mantaray_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/ranging.launch.py"]),
    ],
    install_requires=["setuptools", "pymantaray"],
    extras_require={"test": ["pytest"]},
    zip_safe=True,
    author="The MantaRay developers",
    description="Acoustic ranges with refraction between the vehicles of a simulator, by MantaRay.",
    license="MIT",
    entry_points={"console_scripts": [f"ranging = {NAME}.ranging_node:main"]},
)
