#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Prepares a machine for the field: systemd units, clock, firewall, ROS_IP. Shows what it would do; --apply does it.
#   tools/install_vehicle.sh --role uav1 --radio wlan0 --peers control=192.168.8.10:7447,uav2=192.168.8.12:7447 --keys ~/fcsv-keys
#   tools/install_vehicle.sh --role control --radio wlan0 --peers uav1=192.168.8.11:7447,uav2=192.168.8.12:7447
#   tools/install_vehicle.sh --uninstall
set -euo pipefail
exec /usr/bin/python3 "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")/install" "$@"
