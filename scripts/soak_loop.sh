#!/bin/sh
# A soak of whole commands: does anything pile up when scenes are trained, meshed, rendered and measured again and again?
#
#     scripts/soak_loop.sh SECONDS OUT SCENE...
#
# Trains each SCENE with the default settings, makes its mesh anew, renders an orbit and measures the run, round after round, until SECONDS
# are over; the scene that was begun is ended. The temporary folder is OUT/tmp, and every round writes over the results of the round before.
# Writes OUT/commands.csv: round, scene, command, seconds since the start, peak memory in MB, files in the temporary folder,
# temporary files of `dvr` in OUT, files of the scene's results. Memory is what the allocator had committed at most, as it tells at the
# end (MIMALLOC_SHOW_STATS): resident memory falls where a kernel takes pages back from a process that waits. Prints for each command the
# mean peak memory of the first and of the last third of the rounds. Fails where it grows (by more than two standard errors and 2 %),
# where a temporary file stays, or where the number of files of results changes. Needs `dvr` on the PATH (or in $DVR) and awk. Run it
# from the root of the repository.
set -eu

[ $# -ge 3 ] || { sed -n '2,14s/^# \{0,1\}//p' "$0" >&2; exit 2; }
seconds=$1 out=$2
shift 2
dvr=${DVR:-dvr}
mkdir -p "$out/tmp"
TMPDIR=$(cd "$out/tmp" && pwd)
export TMPDIR
began=$(date +%s)
echo "round,scene,command,seconds,peak_mb,temporary_folder,temporary_files,files_of_results" > "$out/commands.csv"

files_in() { find "$1" -type f | wc -l; }

# Carries a command out and adds its row.
measured() {
    env MIMALLOC_SHOW_STATS=1 "$dvr" "$@" > "$out/output.txt" 2> "$out/notes.txt" \
        || { cat "$out/notes.txt" >&2; echo "round $round, $name: dvr $* failed" >&2; exit 1; }
    peak=$(awk '
        match($0, /peak commit: *[0-9.]+ *[KMGT]iB/) {
            split(substr($0, RSTART + 12, RLENGTH - 12), size, " ")
            scale["KiB"] = 1 / 1024; scale["MiB"] = 1; scale["GiB"] = 1024; scale["TiB"] = 1024 ^ 2
            megabytes = size[1] * scale[size[2]] * 1.048576
        }
        END { if (megabytes > 0) printf "%.1f", megabytes; else exit 1 }' "$out/notes.txt") \
        || { echo "dvr $1 does not tell what it committed: is it a build with mimalloc?" >&2; exit 1; }
    left=$(find "$out" -name '.*.dvr-tmp' | wc -l)
    echo "$round,$name,$1,$(($(date +%s) - began)),$peak,$(files_in "$TMPDIR"),$left,$(files_in "$results")" >> "$out/commands.csv"
}

round=0
is_over() { [ $(($(date +%s) - began)) -ge "$seconds" ]; }
until is_over; do
    round=$((round + 1))
    for scene; do
        is_over && break
        name=$(basename "$scene")
        results=$out/$name
        run=$results/run
        mkdir -p "$results"
        measured train "$scene" --out "$run" --overwrite
        measured mesh "$run" --overwrite
        measured render "$run" --out "$results/orbit" --frames 12 --overwrite
        measured eval "$run"
    done
done

awk -F, -v rounds=$round '
    NR == 1 { next }
    { key = $3 " " $2; end = $4 }
    $1 == 1 { order[++keys] = key }
    # In the first round there are no results of the commands that follow.
    $1 == 2 { files[key] = $8 }
    3 * $1 <= rounds + 2 { n[1, key]++; sum[1, key] += $5; squares[1, key] += $5 ^ 2 }
    3 * $1 > 2 * rounds { n[2, key]++; sum[2, key] += $5; squares[2, key] += $5 ^ 2 }
    $6 > 0 || $7 > 0 { left++ }
    $1 > 2 && $8 != files[key] { changed[key] = 1 }
    # The square of the standard error of a mean.
    function uncertainty(part, key,    m, square) {
        m = sum[part, key] / n[part, key]
        square = n[part, key] > 1 ? (squares[part, key] / n[part, key] - m ^ 2) / (n[part, key] - 1) : 0
        # Rounding, where all are the same.
        return square > 0 ? square : 0
    }
    END {
        printf "%d rounds in %d s, %d commands; temporary files that stayed: %d\n\n", rounds, end, NR - 1, left
        print "| command | peak memory, mean of the first third of the rounds, MB | of the last third | change | |\n|---|---:|---:|---:|---|"
        for (i = 1; i <= keys; i++) {
            key = order[i]
            if (!n[2, key]) continue
            before = sum[1, key] / n[1, key]
            change = sum[2, key] / n[2, key] - before
            error = sqrt(uncertainty(1, key) + uncertainty(2, key))
            verdict = change > 2 * error && change > 0.02 * before ? "GROWS" : "flat"
            if (n[1, key] < 3 || n[2, key] < 3) verdict = verdict " (few rounds)"
            if (key in changed) verdict = verdict ", the number of files changes"
            bad += verdict ~ /^GROWS$|changes/
            printf "| %s | %.1f | %.1f | %+.1f +- %.1f MB | %s |\n", key, before, before + change, change, error, verdict
        }
        exit left > 0 || bad > 0
    }' "$out/commands.csv"
