"""The Python package, for catkin (ROS 1) and ament (ROS 2)."""

import os

NAME = "ariac_score_monitor"

if os.environ.get("ROS_VERSION") == "2":
    from setuptools import setup

    setup(
        name=NAME,
        version="1.0.0",
        packages=[NAME],
        package_dir={"": "src"},
        data_files=[
            ("share/ament_index/resource_index/packages", ["resource/" + NAME]),
            ("share/" + NAME, ["package.xml"]),
            ("share/" + NAME + "/launch", ["launch/monitor.launch.py"]),
        ],
        install_requires=["setuptools"],
        zip_safe=True,
        entry_points={"console_scripts": ["monitor = ariac_score_monitor.ros2:main"]},
    )
else:
    from distutils.core import setup

    from catkin_pkg.python_setup import generate_distutils_setup

    setup(**generate_distutils_setup(packages=[NAME], package_dir={"": "src"}))
