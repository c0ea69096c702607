#!/usr/bin/env bash
# Installs rclpy from the package index into a virtual environment, and builds the two interface
# packages there that the index does not have: install_ros.sh VENV. Needs a C++ compiler.
# Then: source VENV/ros.sh && VENV/bin/python -m pytest tests/fleets/ros2
set -euo pipefail
venv=$(realpath "$1"); work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
names=(rclpy rmw-fastrtps-cpp std-msgs geometry-msgs nav-msgs sensor-msgs diagnostic-msgs action-msgs
  rosidl-default-generators rosidl-default-runtime rosidl-core-generators rosidl-generator-py
  rosidl-typesupport-introspection-cpp rosidl-typesupport-fastrtps-cpp python-cmake-module
  ament-package ament-cmake ament-cmake-include-directories ament-cmake-gmock ament-cmake-gtest
  ament-cmake-pytest ament-cmake-ros ament-cmake-ros-core)
"$venv/bin/pip" install -q cmake ninja catkin_pkg "${names[@]/#/ros-}"
version=$("$venv/bin/python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
include=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_paths()["include"])')
# The wheels' CMake files name the folders of the machine that built them.
built=/opt/python/cp${version//[a-z.]/}-cp${version//[a-z.]/}
mkdir -p "$built/include" "$built/lib/$version"
ln -sfn "$include" "$built/include/$version"
ln -sfn "$venv/lib/$version/site-packages" "$built/lib/$version/site-packages"

package() {  # NAME FILE: an interface package with one file, read from standard input
  mkdir -p "$work/$1/$(dirname "$2")"
  cat > "$work/$1/$2"
  cat > "$work/$1/package.xml" <<XML
<?xml version="1.0"?><package format="3"><name>$1</name><version>1.0.0</version>
<description>Interfaces for tests</description><maintainer email="test@example.com">tests</maintainer>
<license>Apache-2.0</license><buildtool_depend>ament_cmake</buildtool_depend>
<depend>rosidl_default_generators</depend><depend>geometry_msgs</depend><depend>action_msgs</depend>
<member_of_group>rosidl_interface_packages</member_of_group>
<export><build_type>ament_cmake</build_type></export></package>
XML
  cat > "$work/$1/CMakeLists.txt" <<CMAKE
cmake_minimum_required(VERSION 3.20)
project($1)
foreach(name ament_cmake rosidl_default_generators geometry_msgs action_msgs builtin_interfaces)
  find_package(\${name} REQUIRED)
endforeach()
rosidl_generate_interfaces(\${PROJECT_NAME} $2
  DEPENDENCIES geometry_msgs action_msgs builtin_interfaces)
ament_package()
CMAKE
  PATH=$venv/bin:$PATH AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv cmake -G Ninja -S "$work/$1" \
    -B "$work/$1/build" -DCMAKE_INSTALL_PREFIX="$venv" -DPython3_EXECUTABLE="$venv/bin/python"
  "$venv/bin/ninja" -C "$work/$1/build" install
}

package tf2_msgs msg/TFMessage.msg <<'MSG'
geometry_msgs/TransformStamped[] transforms
MSG
package nav2_msgs action/NavigateToPose.action <<'ACTION'
geometry_msgs/PoseStamped pose
string behavior_tree
---
uint16 NONE=0
uint16 error_code
string error_msg
---
geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
ACTION
cat > "$venv/ros.sh" <<SH
export AMENT_PREFIX_PATH=$venv LD_LIBRARY_PATH=$venv/lib
SH
