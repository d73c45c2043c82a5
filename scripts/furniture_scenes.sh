#!/bin/sh
# Scenes that no setting was chosen on: one piece of furniture of each category of `furniture.sh`, rendered under bad light (highlights, hard
# shadows, pixel noise, exposures that differ). Runs the default and the visual hull on all of them.
#
#     scripts/furniture_scenes.sh FURNITURE OUT [further arguments of `dvr bench`]
#
# FURNITURE is the folder that `furniture.sh` made. Needs `dvr` on the PATH (or in $DVR).
set -eu

[ $# -ge 2 ] || { sed -n '2,7s/^# \{0,1\}//p' "$0" >&2; exit 2; }
furniture=$1
out=$2
shift 2
dvr=${DVR:-dvr}
mkdir -p "$out"

cat > "$out/synth.json" <<'JSON'
{
  "width": 128,
  "height": 128,
  "noise": 0.02,
  "exposure_jitter": 0.1,
  "lighting": {
    "ambient": 0.35,
    "lights": [
      { "direction": [0.5, 0.8, 0.4], "intensity": 0.6 },
      { "direction": [-0.6, -0.3, -0.7], "intensity": 0.25 }
    ],
    "specular": 0.4,
    "shininess": 30.0,
    "shadows": true
  }
}
JSON

for folder in "$furniture"/meshes/*; do
    category=$(basename "$folder")
    [ -d "$out/data/$category" ] && continue
    mesh=$(find "$folder" -name '*.obj' | sort | head -n 1)
    "$dvr" synth "$mesh" --category "$category" --config "$out/synth.json" --out "$out/data"
done

"$dvr" bench "$out"/data/*/*/ --out "$out/bench" "$@"
