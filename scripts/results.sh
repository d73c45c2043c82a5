#!/bin/sh
# Makes the tables and charts of docs/results and the README, at the commit that is checked out.
#
#     scripts/results.sh --list                  the parts, how long each takes, what it needs
#     scripts/results.sh [--write] OUT [PART...] makes parts (all that have their scenes); --write puts them into the pages
#
# Results lie in OUT: rows that are there and are of this commit, machine, scene and settings are kept, so the same command goes on where it
# was stopped. OUT/blocks holds the tables; --write copies them between the marks of the pages, with their CSV files and charts, and refuses a
# program of a tree with changes. Read the conclusions of these pages again afterwards: people write them.
#
# Scenes: those that this script renders, the demo scene, and with DVR_SCENES=DIR downloaded ones (docs/guide/scenes.md); the part
# `photographs` takes those of its scenes that are there. DVR_SEEDS=1 takes one seed in place of three, for a look. Takes `dvr` from $DVR,
# else builds it with --release; DVR_BEFORE, another build of it, has a column beside it in `stress-photographs`. Nothing else should run
# meanwhile.
set -eu

root=$(cd "$(dirname "$0")/.." && pwd)
. "$root/scripts/results/parts.sh"

write=no

usage() { sed -n '2,15s/^# \{0,1\}//p' "$0" >&2; exit 2; }

# Whether the scenes of a part are there: all for a page, some where a part takes some.
has_scenes() {
    if [ "$write" = no ] && takes_some "$1"; then
        [ -n "$(there $(scenes_of "$1"))" ]
        return
    fi
    for scene in $(scenes_of "$1"); do
        [ -e "${DVR_SCENES:-/nonexistent}/$scene" ] || return 1
    done
}

list() {
    printf '%-24s%9s  %s\n' part minutes makes
    for part in $PARTS; do
        note=
        has_scenes "$part" || note=" [needs DVR_SCENES with: $(scenes_of "$part")]"
        printf '%-24s%9s  %s%s\n' "$part" "$(minutes_of "$part")" "$(makes "$part")" "$note"
    done
    echo "Minutes are estimates for two cores of an AMD EPYC, with a release build, three seeds, all scenes and nothing kept."
}

while :; do
    case ${1:-} in
        --list) list; exit ;;
        --write) write=yes; shift ;;
        -*) usage ;;
        *) break ;;
    esac
done
[ $# -ge 1 ] || usage
mkdir -p "$1/blocks"
out=$(cd "$1" && pwd)
shift
case $out in *[[:space:]]*) echo "$out: choose a folder without spaces in its path" >&2; exit 2 ;; esac

# What is to be made, and how long that takes.
chosen=
total=0
for part in ${*:-$PARTS}; do
    case " $PARTS " in *" $part "*) ;; *) echo "there is no part $part; --list shows all" >&2; exit 2 ;; esac
    if has_scenes "$part"; then
        chosen="$chosen $part"
        total=$((total + $(minutes_of "$part")))
    elif [ $# -gt 0 ]; then
        echo "$part needs these scenes in the folder DVR_SCENES (docs/guide/scenes.md): $(scenes_of "$part")" >&2
        exit 2
    else
        echo "left out: $part, whose scenes are not there ($(scenes_of "$part"))"
    fi
done
if [ -z "${DVR:-}" ]; then
    cargo build --release --manifest-path "$root/Cargo.toml"
    DVR=$root/target/release/dvr
fi
DVR=$(command -v "$DVR") || { echo "DVR: there is no such program" >&2; exit 2; }
case $DVR in /*) ;; *) DVR=$(pwd)/$DVR ;; esac
version=$("$DVR" --version)
case $write:$SEEDS in
    yes:3 | no:*) ;;
    *) echo "DVR_SEEDS=$SEEDS: pages have three seeds; write them without it" >&2; exit 2 ;;
esac
case $write:$version in
    yes:*-dirty*) echo "$version: pages say of which commit they are; commit the changes first" >&2; exit 2 ;;
esac
echo "$version: about $total minutes for$chosen, less what is kept in $out"

cd "$root"
for part in $chosen; do
    echo "== $part: about $(minutes_of "$part") minutes"
    "part_$(echo "$part" | tr - _)"
done
echo "The tables are in $out/blocks."
[ "$write" = no ] || echo "The pages were written. Read their conclusions again, and run: git diff docs README.md"
