#!/usr/bin/env bash
# A real kernel's USB stack in a virtual machine: playback through usbcore, usbfs, xhci and vhci_hcd. By hand, not in CI.
#
#   apt-get install qemu-system-x86 busybox-static cpio kmod && apt-get download linux-image-6.1.0-56-amd64
#   tests/device/tiers/vm/run.sh linux-image-*.deb [PYTHON]
#
# Nothing is installed in the machine: its root is this one's, read-only over 9p, so PYTHON (python3) must have palpate
# with its test extra. A board behind USB/IP is played to, and looked at, inside. Takes about two minutes: the processor is
# emulated too (a Nehalem: with all that QEMU 7.2 can, NumPy sorts wrongly).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
kernel_package=$(realpath "$1")
python=$(command -v "${2:-python3}")
for tool in qemu-system-x86_64 busybox cpio depmod dpkg-deb; do
  command -v "$tool" >/dev/null || { echo "$tool is missing; see the head of $0" >&2; exit 2; }
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

dpkg-deb -x "$kernel_package" "$work/kernel"
release=$(basename "$work"/kernel/lib/modules/*)
root=$work/root
mkdir -p "$root"/{bin,proc,sys,dev,host,lib/modules}
cp "$(command -v busybox)" "$root/bin/busybox"
depmod -b "$work/kernel" "$release"
cp -r "$work/kernel/lib/modules/$release" "$root/lib/modules/"
for folder in sound drivers/gpu drivers/net drivers/media fs/xfs fs/btrfs; do
  rm -rf "$root/lib/modules/$release/kernel/$folder"
done
cp "$here/init" "$root/init"
chmod +x "$root/init"
printf '%s\n' "$python" "$here" >"$root/where"
(cd "$root" && find . | cpio --quiet -o -H newc | gzip -1) >"$work/initramfs"

timeout "${VM_TIMEOUT:-600}" qemu-system-x86_64 \
  -accel tcg -cpu Nehalem -smp 2 -m 2048 -nographic -no-reboot -nodefaults -serial stdio \
  -kernel "$work"/kernel/boot/vmlinuz-* -initrd "$work/initramfs" -append "console=ttyS0 panic=-1 quiet" \
  -virtfs local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap \
  -device qemu-xhci </dev/null |
  tr -d '\r' | tee "$work/console"

"$python" "$here/check.py" "$work/console"
