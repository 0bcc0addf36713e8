#!/bin/bash
# Runs in the virtual machine: installed.sh SUITE BOOT [SCENE...]. The first boot installs the wheels.
set -euo pipefail
cd /mnt/host

suite=$1 boot=$2
shift
venv=/opt/litegripd
if [[ $boot == 1 && $suite != debian ]]; then  # that one has packages of its own
    python3 -m venv --without-pip "$venv"
    pip --quiet --python "$venv/bin/python" install --disable-pip-version-check \
        --root-user-action=ignore --no-index --find-links wheels 'litegripd[web]'
fi
modprobe vcan
ip link add dev vcan0 type vcan
ip link set vcan0 up

mkdir -p /root/logs
cd /root
status=0
PATH=$venv/bin:$PATH PYTHONPATH=/mnt/host python3 -m "tests.vm.$suite" "$@" || status=$?
mkdir -p "/mnt/host/logs/$suite-$boot"
cp -r logs/. "/mnt/host/logs/$suite-$boot"
exit "$status"
