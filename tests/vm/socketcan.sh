#!/bin/bash
# Runs in the virtual machine: installs the wheels, sets up the interfaces, runs socketcan.py.
set -euo pipefail
cd /mnt/host

venv=/opt/litegripd
python3 -m venv --without-pip "$venv"
pip --quiet --python "$venv/bin/python" install --disable-pip-version-check --root-user-action=ignore \
    --no-index --find-links wheels litegripd "$(cat driver)"

modprobe vcan
ip link add dev vcan0 type vcan
ip link set vcan0 up
for card in can0 can1; do
    ip link set "$card" up type can bitrate 1000000
done
mkdir -p /etc/litegripd
# Half the daemon's usual rate, without priority: an emulated machine has no more to give.
for channel in vcan0 vcan9 can0; do
    printf '[gripper]\nmount = "normal"\n[control]\nrate_hz = 100\npriority = 0\n' \
        >"/etc/litegripd/$channel.toml"
done

# The logs are copied at the end: writing each frame to the host would slow all down.
mkdir /root/logs
cd /root
status=0
PATH=$venv/bin:$PATH PYTHONPATH=/mnt/host python -m tests.vm.socketcan "$@" || status=$?
cp -r logs /mnt/host/
exit "$status"
