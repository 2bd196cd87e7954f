#!/usr/bin/env bash
# The part of smoke.sh that is root of its own namespaces; nothing it mounts or registers is seen outside.
set -euo pipefail

readonly ARCH=$1 SYSTEM=$2 WORK=$3 EMULATOR=$4 BINFMT=$5

# Only what the daemon needs, so that it cannot reach a device of this machine.
mount_devices() {
  local device
  mount -t tmpfs none "$SYSTEM/dev"
  for device in null zero random urandom; do
    : >"$SYSTEM/dev/$device"
    mount --bind "/dev/$device" "$SYSTEM/dev/$device"
  done
  mkdir "$SYSTEM/dev/pts"
  mount -t devpts -o newinstance,ptmxmode=0666 none "$SYSTEM/dev/pts"
  ln -s pts/ptmx "$SYSTEM/dev/ptmx"
}

# Nothing to do where the processor or an emulator that the host registered runs the system's programs.
register_emulator() {
  chroot "$SYSTEM" /bin/true 2>/dev/null && return
  mount -t binfmt_misc none "$BINFMT"
  cat "$EMULATOR" >"$BINFMT/register"
}

cd /
mount_devices
mount -t proc none "$SYSTEM/proc"
mount -t tmpfs none "$SYSTEM/tmp"
mount --bind "$WORK" "$SYSTEM/mnt"
register_emulator
env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin PYTHONPATH=/mnt/app LANG=C.UTF-8 \
  timeout --foreground 300 chroot "$SYSTEM" python3 /mnt/loopback.py "$ARCH"
