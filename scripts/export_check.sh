#!/bin/sh
# Checks an unlit GLB of this program, as `dvr train` and `dvr texture` write it, as other programs see it: Khronos'
# validator, Blender, and three.js in Chromium.
#
#     scripts/export_check.sh MESH.glb OUT [ARGUMENTS of dvr render, as --data SCENE or --up z]
#
# - the validator has no message: no error, warning, information or hint;
# - the file says what made it, and its node, mesh, material and picture have names, which arrive in both programs;
# - the faces have the same extent in both programs as in MESH.ply (or MESH.glb itself, where that is not there), in the
#   axes of glTF (+y up), which Blender turns to +z;
# - pictures from the same cameras are those of `dvr render`: more than 35 dB within the silhouettes, which are alike by
#   more than .998 of their union. All three render pictures of 2048 pixels without antialiasing, of which each 4x4 are
#   averaged. Blender: Cycles on the CPU, the view transform Standard. three.js: no tone mapping.
#
# Where MESH.usdz of the same mesh lies beside, three.js shows that, too, and OpenUSD's validators have no message, where
# python3 has them (pip install usd-core; without them it says so).
#
# Pictures, side by side with their differences, lie in OUT/sheets, figures in OUT/figures.json. Exit code 1: something
# differs. It needs Blender (3.4 or later) with numpy, Chromium, node and npm: `apt install blender python3-numpy chromium
# nodejs npm`. Modules of npm are kept in $DVR_EXPORT_CACHE (~/.cache/dvr-export-check). Takes `dvr` from $DVR, else
# target/release/dvr.
set -eu

[ $# -ge 2 ] || { sed -n '2,21s/^# \{0,1\}//p' "$0" >&2; exit 2; }
root=$(cd "$(dirname "$0")/.." && pwd)
here=$root/scripts/export_check
mesh=$1
out=$2
shift 2
[ -f "$mesh" ] || { echo "$mesh: there is no such file" >&2; exit 2; }
dvr=${DVR:-$root/target/release/dvr}
chromium=
for name in chromium chromium-browser google-chrome google-chrome-stable; do
    [ -n "$chromium" ] || chromium=$(command -v "$name" || true)
done
for program in "$dvr" blender node npm "${chromium:-chromium}"; do
    command -v "$program" >/dev/null || {
        echo "$program is missing: apt install blender python3-numpy chromium nodejs npm; cargo build --release" >&2
        exit 2
    }
done
cache=${DVR_EXPORT_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/dvr-export-check}
mkdir -p "$cache" "$out"
out=$(cd "$out" && pwd)
cmp -s "$here/package.json" "$cache/package.json" && [ -d "$cache/node_modules" ] || {
    cp "$here/package.json" "$cache/package.json"
    npm install --prefix "$cache" --no-audit --no-fund --silent
}
echo "$("$dvr" --version); $(blender --version | head -n 1); $("$chromium" --version 2>/dev/null)"

failed=0
node "$here/validate.mjs" "$cache" "$mesh" "$out/validator.json" || failed=1

# From above and from below, so that every side is seen.
for orbit in above:25 below:-40; do
    name=${orbit%%:*}
    "$dvr" render "$mesh" --out "$out/ours/$name" --overwrite --frames 3 --size 2048 --elevation "${orbit##*:}" \
        --animation none --normals "$@" >"$out/ours_$name.log" 2>&1 || { cat "$out/ours_$name.log" >&2; exit 1; }
done
blender --background --factory-startup --python-exit-code 1 --python "$here/blender_render.py" -- \
    "$mesh" "$out" above below >"$out/blender.log" 2>&1 || { tail -n 20 "$out/blender.log" >&2; exit 1; }
node "$here/three_render.mjs" "$cache" "$chromium" "$mesh" "$out" three above below
usdz=${mesh%.*}.usdz
if [ -f "$usdz" ]; then
    node "$here/three_render.mjs" "$cache" "$chromium" "$usdz" "$out" usdz above below
    if python3 -c 'import pxr' 2>/dev/null; then
        python3 "$here/validate_usdz.py" "$usdz" || failed=1
    else
        echo "not validated: $usdz (pip install usd-core)"
    fi
fi
reference=${mesh%.*}.ply
[ -f "$reference" ] || reference=$mesh
# Blender's Python has numpy and reads pictures.
blender --background --factory-startup --python-exit-code 1 --python "$here/compare.py" -- \
    "$mesh" "$reference" "$out" above below >"$out/compare.log" 2>&1 || failed=1
sed -n '/^| /p; /^FAILED/p; /^ok/p; /Error/p' "$out/compare.log"
[ "$failed" = 0 ] || { echo "The export differs: see $out" >&2; exit 1; }
echo "The export is the same everywhere."
