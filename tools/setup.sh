#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Brings a machine from nothing to a built workspace; safe to repeat, quick when nothing is to do.
#   tools/setup.sh          Debian 12 (its own ROS packages) or Ubuntu 20.04 with Noetic
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

STEP=""
step() { STEP=$1; say "$1"; }
say()  { if [ -t 1 ]; then printf '\033[1m[setup]\033[0m %s\n' "$*"; else printf '[setup] %s\n' "$*"; fi; }
fail() { printf '[setup] ERROR: %s\n' "$*" >&2; exit 1; }

quietly() {  # quietly LOG COMMAND...: its output into LOG, and every few seconds the step with its seconds
  local log=$1 began=$SECONDS child status shown=0 every=15; shift
  [ -t 1 ] && every=1
  "$@" >"$log" 2>&1 &
  child=$!
  trap 'kill $child 2>/dev/null' INT TERM
  while kill -0 $child 2>/dev/null; do
    sleep 0.2
    [ $((SECONDS - began)) -ge $((shown + every)) ] || continue
    shown=$((SECONDS - began))
    if [ -t 1 ]; then printf '\r\033[K[setup]   %s: %d s' "${STEP:0:60}" $shown; else say "  ${STEP:0:60}: $shown s"; fi
  done
  [ -t 1 ] && printf '\r\033[K'
  wait $child && status=0 || status=$?
  trap - INT TERM
  return $status
}

PYTHON=/usr/bin/python3   # the only interpreter that sees the system's ROS
MSGS="std sensor nav geometry diagnostic visualization actionlib"

debian_packages() {
  echo build-essential cmake python3-venv python3-dev iproute2 nftables rsync \
    ros-base catkin rviz rosbash rospack-tools topic-tools \
    python3-rospy python3-rosbag python3-roslaunch python3-rostest python3-rosmaster python3-rosnode \
    python3-tf2-ros python3-tf2-geometry-msgs python3-cv-bridge python3-actionlib python3-std-srvs \
    python3-diagnostic-updater python3-camera-calibration-parsers python3-interactive-markers python3-rviz python3-python-qt-binding python3-pyqt5 \
    ros-nav-msgs ros-sensor-msgs xvfb libembree3-3 python3-cryptography \
    python3-map-msgs python3-move-base-msgs octomap-tools
  for m in $MSGS; do [ "$m" = actionlib ] || echo "lib$m-msgs-dev python3-$m-msgs"; done
}

noetic_packages() {
  echo build-essential cmake python3-venv python3-dev iproute2 nftables rsync xvfb octomap-tools
  for p in ros-base rviz rosbash topic-tools tf2-ros tf2-geometry-msgs cv-bridge actionlib std-srvs \
           diagnostic-updater camera-calibration-parsers interactive-markers rostest python-qt-binding rosbag map-msgs move-base-msgs; do echo "ros-noetic-$p"; done
  for m in $MSGS; do [ "$m" = actionlib ] || echo "ros-noetic-$m-msgs"; done
}

platform() {  # sets DISTRO and PACKAGES
  [ -r /etc/os-release ] || fail "no /etc/os-release: fcsv runs on Debian 12 and Ubuntu 20.04"
  # shellcheck disable=SC1091
  . /etc/os-release
  case "$ID-$VERSION_ID" in
    debian-12) DISTRO=debian; PACKAGES=$(debian_packages) ;;
    ubuntu-20.04)
      DISTRO=noetic; PACKAGES=$(noetic_packages)
      apt-cache show ros-noetic-ros-base >/dev/null 2>&1 ||
        fail "the ROS Noetic package source is not configured on this Ubuntu 20.04; add it as ROS's own installation page says, then run 'make setup' again" ;;
    *) fail "$PRETTY_NAME is not supported: use Debian 12 or Ubuntu 20.04 with ROS Noetic" ;;
  esac
}

missing_packages() {
  local have
  have=$(dpkg-query -W -f '${binary:Package} ${db:Status-Status}\n' 2>/dev/null | awk '$2=="installed"{sub(/:.*/,"",$1); print $1}' | sort -u)
  # shellcheck disable=SC2086
  comm -23 <(tr ' ' '\n' <<<$PACKAGES | sort -u) <(printf '%s\n' "$have")
}

system_packages() {
  local lacking sudo=""
  lacking=$(missing_packages)
  [ -z "$lacking" ] && return
  step "installing system packages: $(tr '\n' ' ' <<<"$lacking")"
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || fail "these packages are missing and there is no sudo; install them as root: $(tr '\n' ' ' <<<"$lacking")"
    sudo="sudo"
    sudo true || fail "sudo gave no rights to install: $(tr '\n' ' ' <<<"$lacking")"  # asks for a password now
  fi
  quietly build/apt-update.log $sudo apt-get update -q || fail "'apt-get update' failed: check the network and the package sources"
  # shellcheck disable=SC2086
  quietly build/apt.log $sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $lacking ||
    { tail -5 build/apt.log >&2; fail "apt-get could not install the packages (whole log: build/apt.log)"; }
}

virtual_environment() {
  local want
  want=$(sha256sum requirements.txt | cut -d' ' -f1)
  if [ -x .venv/bin/python ] && [ "$(cat .venv/fcsv-requirements 2>/dev/null)" = "$want" ]; then return; fi
  step "installing pinned Python packages into .venv"
  [ -x .venv/bin/python ] || "$PYTHON" -m venv --system-site-packages .venv
  quietly build/pip.log .venv/bin/python -m pip install -q --disable-pip-version-check -r requirements.txt ||
    { tail -5 build/pip.log >&2; fail "pip could not install requirements.txt (whole log: build/pip.log)"; }
  echo "$want" >.venv/fcsv-requirements
}

mavros_messages() {  # src/mavros_msgs stands in for MAVROS's definitions, and steps back where the real package is
  local mark=src/mavros_msgs/CATKIN_IGNORE real
  [ "$DISTRO" = noetic ] && . /opt/ros/noetic/setup.sh
  real=$(cmake -P src/mavros_msgs/cmake/real_mavros_msgs.cmake 2>&1)
  if [ -n "$real" ] && [ ! -e "$mark" ]; then
    say "the real mavros_msgs is in $real: src/mavros_msgs is left out"
    echo "written by tools/setup.sh: the real mavros_msgs is in $real" >"$mark"
    rm -rf build/mavros_msgs devel/{include,lib/python3/dist-packages,share,share/common-lisp/ros}/mavros_msgs
  elif [ -z "$real" ] && grep -qs '^written by tools/setup.sh' "$mark"; then
    say "no real mavros_msgs any more: src/mavros_msgs is built"
    rm -f "$mark"
  fi
}

workspace() {  # configure and build catkin; nothing to do when no message, node or package file changed
  local stamp=build/fcsv-built want
  want=$( { find src -name CMakeLists.txt -o -name package.xml -o -name setup.py -o -path '*/msg/*' -o -path '*/srv/*' -o -path '*/action/*' -o -name '*.c' -o -name '*.cmake' -o -name CATKIN_IGNORE -o -path '*/nodes/*' -type f
            echo CMakeLists.txt; } | LC_ALL=C sort | while read -r f; do [ -f "$f" ] && case "$f" in */nodes/*) echo "$f" ;; *) sha256sum "$f" ;; esac; done; pwd )
  [ -f devel/setup.sh ] && [ "$(cat $stamp 2>/dev/null)" = "$want" ] && return
  step "building the catkin workspace"
  [ "$DISTRO" = noetic ] && . /opt/ros/noetic/setup.sh
  # no client library but C++ and Python is used, so the others are not generated
  quietly build/cmake.log env ROS_LANG_DISABLE=geneus:genlisp:gennodejs cmake -S . -B build -DPYTHON_EXECUTABLE="$PWD/.venv/bin/python" ||
    { tail -15 build/cmake.log >&2; fail "cmake could not configure the workspace (whole log: build/cmake.log)"; }
  quietly build/build.log cmake --build build -j"$(nproc)" ||
    { tail -15 build/build.log >&2; fail "the build failed (whole log: build/build.log)"; }
  echo "$want" >$stamp
}

kernels() {  # numba's cache lies beside the sources; compile where they changed
  local want
  want=$(find src/fcsv_stereo/src/fcsv_stereo/joint -name '*.py' -print0 | LC_ALL=C sort -z | xargs -0 cat | sha256sum | cut -d' ' -f1)
  [ "$(cat build/fcsv-kernels 2>/dev/null)" = "$want" ] && return
  step "compiling kernels"
  quietly build/kernels.log bash -c '. devel/setup.sh && exec .venv/bin/python -m fcsv_stereo.in_flight.warm_up' ||
    { tail -5 build/kernels.log >&2; fail "the kernels could not be compiled (whole log: build/kernels.log)"; }
  echo "$want" >build/fcsv-kernels
}

case "$PWD" in
  *[[:space:]]*) fail "the path '$PWD' holds a blank: catkin cannot build there; move the folder to a path without blanks" ;;
esac
mkdir -p build
platform
[ -d .venv ] || say "the first time: about four minutes, 2.5 GB in this folder (.venv), 1 GB of system packages where ROS is missing"
system_packages
virtual_environment
mavros_messages
workspace
kernels
say "ready: . devel/setup.sh"
