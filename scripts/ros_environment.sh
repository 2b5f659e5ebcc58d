# Sourced by the other scripts: runs Debian's ROS from a build folder without an installed workspace.
# Usage: source scripts/ros_environment.sh BUILD_FOLDER      (from the repository's root)

acmp_build=$(realpath "$1")              # roscore and tests change folders
export PYENV_VERSION=system              # Debian's ROS modules belong to /usr/bin/python3, not to a pyenv
export ROS_HOSTNAME=localhost            # a machine's own name need not resolve
export ROSCONSOLE_STDOUT_LINE_BUFFERED=1 # else the last lines of a killed node are lost
export ROS_HOME="$acmp_build/ros_home"
export ROS_PACKAGE_PATH="$PWD${ROS_PACKAGE_PATH:+:$ROS_PACKAGE_PATH}"
export CMAKE_PREFIX_PATH="$acmp_build/devel${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}"
export PATH="$acmp_build/devel/lib/acmp_mapping:$PATH" # rosrun finds no programs in a build folder of the package
export PYTHONPATH="$acmp_build/devel/lib/python3/dist-packages${PYTHONPATH:+:$PYTHONPATH}"
