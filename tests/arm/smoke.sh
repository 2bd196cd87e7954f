#!/usr/bin/env bash
# The daemon's loopback smoke on Debian 12 for ARM, emulated: `make nightly`, or tests/arm/smoke.sh PIP [ARCH...]
#
# Exit code 0 = it runs, 1 = it does not, 2 = this machine cannot try. Needs root and, the first time, a network.
# This machine keeps: missing Debian packages and the two systems in $WAYFIX_ARM_CACHE. Mounts and processes live in
# namespaces that end with the test, and so does the emulator's registration.
set -euo pipefail
cd "$(dirname "$0")/../.."

readonly SUITE=bookworm
readonly PACKAGES=python3,python3-zmq,python3-msgpack,python3-serial,python3-nmea2,python3-systemd
readonly CACHE=${WAYFIX_ARM_CACHE:-/var/cache/wayfix-arm} # not under a home: a user namespace cannot enter those of others
readonly BINFMT=/proc/sys/fs/binfmt_misc
declare -rA EMULATOR=([armhf]=/usr/lib/binfmt.d/qemu-arm.conf [arm64]=/usr/lib/binfmt.d/qemu-aarch64.conf)

say() {
  echo "nightly: $*" >&2
}

cannot() {
  say "$@"
  exit 2
}

install_tools() {
  local missing=()
  command -v debootstrap >/dev/null || missing+=(debootstrap)
  [[ -e /usr/share/keyrings/debian-archive-keyring.gpg ]] || missing+=(debian-archive-keyring)
  [[ -e ${EMULATOR[armhf]} && -e ${EMULATOR[arm64]} ]] || missing+=(qemu-user-static)
  [[ ${#missing[@]} -gt 0 ]] || return 0
  command -v apt-get >/dev/null || cannot "${missing[*]} missing and no apt-get here: install them by hand"
  say "installing ${missing[*]} with apt-get"
  { apt-get update && apt-get install -y --no-install-recommends "${missing[@]}"; } >"$work/apt.log" 2>&1 ||
    cannot "apt-get cannot install ${missing[*]}; is there a network?"$'\n'"$(tail -n 5 "$work/apt.log")"
}

# Packages are only unpacked: running their scripts under emulation takes ten minutes and nothing here needs them.
build_system() {
  local arch=$1 system=$2 package started=$SECONDS
  say "$arch: fetching Debian $SUITE into $system"
  rm -rf --one-file-system "$system"
  debootstrap --arch="$arch" --variant=minbase --foreign --include="$PACKAGES" "$SUITE" "$system.new" \
    >"$work/$arch.log" 2>&1 ||
    cannot "$arch: cannot fetch Debian's packages; is there a network?"$'\n'"$(tail -n 5 "$work/$arch.log")"
  for package in "$system.new"/var/cache/apt/archives/*.deb; do
    dpkg-deb --fsys-tarfile "$package" | tar -x --keep-directory-symlink -C "$system.new"
  done
  rm -rf --one-file-system "$system.new"/var/cache/apt/archives "$system.new/debootstrap"
  [[ ! -L $system.new/proc ]] || rm "$system.new/proc" # in a container debootstrap links it to the machine's
  mkdir -p "$system.new/proc" "$system.new/mnt"
  echo "$SUITE $PACKAGES" >"$system.new/wayfix-packages"
  mv "$system.new" "$system"
  say "$arch: $(du -sh "$system" | cut -f1) in $((SECONDS - started)) s"
}

# A mount namespace alone would not do: the registry belongs to the user namespace (Linux 6.7), before that to the kernel.
namespaces() {
  local private=(--user --map-root-user --mount)
  if unshare "${private[@]}" mount -t binfmt_misc none "$BINFMT" 2>/dev/null; then
    echo "${private[@]}"
  elif grep -qs '^flags:.*F' "$BINFMT"/qemu-arm && grep -qs '^flags:.*F' "$BINFMT"/qemu-aarch64; then
    echo --mount
  fi
}

run() {
  local arch=$1 system=$2
  # shellcheck disable=SC2086 # options are words
  unshare $options --pid --fork --kill-child \
    bash "$work/inside.sh" "$arch" "$system" "$work" "${EMULATOR[$arch]}" "$BINFMT"
}

[[ $# -gt 0 ]] || cannot "usage: tests/arm/smoke.sh PIP [armhf|arm64 ...]"
[[ $EUID -eq 0 ]] || cannot "needs root for a chroot and its mounts: sudo make nightly"
pip=$1
shift
[[ $# -gt 0 ]] || set -- armhf arm64

mkdir -p "$CACHE"
exec 9>"$CACHE/lock"
flock --nonblock 9 || cannot "another run uses $CACHE"
work=$(mktemp -d)
trap 'rm -rf --one-file-system "$work" "$CACHE"/*.new' EXIT
trap 'exit 130' INT TERM
install_tools
options=$(namespaces)
[[ -n $options ]] || cannot "no emulator is registered (systemctl restart systemd-binfmt) and this kernel has no private registry"
"$pip" install --quiet --disable-pip-version-check --root-user-action=ignore --no-deps --no-compile --target "$work/app" .
cp tests/arm/loopback.py tests/arm/inside.sh "$work"

for arch; do
  [[ -v EMULATOR[$arch] ]] || cannot "$arch is not known: armhf, arm64"
  built=$(cat "$CACHE/$arch/wayfix-packages" 2>/dev/null || true)
  [[ $built == "$SUITE $PACKAGES" ]] || build_system "$arch" "$CACHE/$arch"
done

code=0
for arch; do
  if ! run "$arch" "$CACHE/$arch"; then
    say "$arch: failed, see above"
    code=1
  fi
done
exit "$code"
