#!/bin/bash
# The tests with real ROS 2: builds the package by colcon, then runs pytest beside simulated daemons,
# which are met here, and through a fleet's portal (`-k here`, `-k portal` for one of the two).
#
#   run.sh DISTRO FOLDER LITEGRIPD [ARGUMENTS OF PYTEST]
#
# Of this project only litegrip_client is on the path; LITEGRIPD is the daemon's program, beside the
# Python that has it and the fleet.
set -euo pipefail
distro=$1 folder=$2 daemon=$3
shift 3
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../.." && pwd)
"$here/environment.sh" "$distro" "$folder"
venv=$(cd "$folder" && pwd)

unset PYTHONPATH
export PATH=$venv/bin:$PATH LD_LIBRARY_PATH=$venv/lib AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv
export RMW_IMPLEMENTATION=rmw_fastrtps_cpp ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-$(($$ % 100 + 1))}
rm -rf "$venv/workspace"
mkdir -p "$venv/workspace" "$venv/alone"
ln -sfn "$root/litegrip_client" "$venv/alone/litegrip_client"
(cd "$venv/workspace" && colcon --log-base log build --base-paths "$here/.." --packages-select litegrip_ros2 \
    --event-handlers console_direct- console_cohesion- >build.log 2>&1) || { cat "$venv/workspace/build.log" >&2; exit 1; }
set +u
. "$venv/workspace/install/local_setup.bash"
set -u
export PYTHONPATH=$venv/alone:${PYTHONPATH:-}
LITEGRIPD=$daemon exec "$venv/bin/python" -m pytest -q -p no:cacheprovider --timeout 120 \
    --rootdir "$here" -c "$here/pytest.ini" "$here" "$@"
