#!/bin/sh
# A soak test: does a long training keep its memory and its pace?
#
#     scripts/soak.sh BACKEND STEPS OUT [further arguments of `dvr train`]
#
# Trains a small network (with METHOD=grid in the environment: a grid of 32 cells) on the demo scene (pictures of 32 pixels) for STEPS
# steps on cpu, gpu, gpu:N, ndarray or cuda, with validations and checkpoints, and samples the memory of the process (Linux: resident set
# size from /proc; with a software adapter this is the memory of the device, too; for a graphics card, nvidia-smi is asked where it is
# installed).
# Writes OUT/memory.csv (seconds since the start, MB; MB of the card) and OUT/pace.csv (step, milliseconds per step and CPU milliseconds
# per step since the row before). Prints for each its mean, how far a straight line through it rises, with standard error, and whether it
# is flat (within two standard errors of zero, or less than 2 % of the mean), grows or falls. The first quarter is left out: caches fill
# and the shape is found there. Needs `dvr` on the PATH (or in $DVR) and awk. Run it from the root of the repository.
set -eu

[ $# -ge 3 ] || { sed -n '2,14s/^# \{0,1\}//p' "$0" >&2; exit 2; }
backend=$1 steps=$2 out=$3
shift 3
dvr=${DVR:-dvr}
# Seconds between two samples of the memory, and rows of pace.csv.
pause=${PAUSE:-1}
rows=40
mkdir -p "$out"

case ${METHOD:-network} in
    network)
        set -- --set model.hidden=32 --set model.blocks=2 --set model.octaves=2 --set rays=64 --set losses.normal_points=16 \
            --set hull.warm_start_steps=60 --set hull.warm_start_points=256 --set 'march=[{"from_percent":0,"samples":24}]' \
            --set validate_every=1000 --set checkpoint_every=500 "$@" ;;
    grid) set -- --capacity 32 --set first_cells=32 --set rays=256 "$@" ;;
    *) echo "METHOD is network or grid" >&2; exit 2 ;;
esac

"$dvr" train assets/scenes/mug/mug --downscale 4 --out "$out/run" --overwrite --method "${METHOD:-network}" --backend "$backend" \
    --steps "$steps" --resolution 32 --no-report "$@" \
    > "$out/output.txt" 2> "$out/notes.txt" &
process=$!
trap 'kill $process 2>/dev/null || true' INT TERM

echo "seconds,resident_mb,card_mb" > "$out/memory.csv"
began=$(date +%s)
while kill -0 $process 2>/dev/null; do
    resident=$(awk '/^VmRSS:/ { print $2 / 1024 }' /proc/$process/status 2>/dev/null || true)
    card=""
    if command -v nvidia-smi > /dev/null; then
        card=$(nvidia-smi --query-compute-apps=pid,used_memory --format=csv,noheader,nounits 2>/dev/null \
            | awk -F', *' -v pid=$process '$1 == pid { print $2 }') || true
    fi
    [ -z "$resident" ] || echo "$(($(date +%s) - began)),$resident,$card" >> "$out/memory.csv"
    sleep "$pause"
done
wait $process || { cat "$out/notes.txt" >&2; exit 1; }

awk -F, -v every=$((steps / rows)) '
    BEGIN { print "step,ms_per_step,cpu_ms_per_step" }
    NR == 1 { for (i = 1; i <= NF; i++) column[$i] = i; next }
    $1 % every == 0 {
        seconds = $column["seconds"]; cpu = $column["cpu_seconds"]
        if (last) printf "%d,%.4f,%.4f\n", $1, 1000 * (seconds - s) / ($1 - last), 1000 * (cpu - c) / ($1 - last)
        last = $1; s = seconds; c = cpu
    }' "$out/run/metrics.csv" > "$out/pace.csv"

# The mesh and its figures, made after training, take memory of their own.
trained=$(awk -F, 'NR == 1 { for (i = 1; i <= NF; i++) if ($i == "seconds") column = i; next } { last = $column } END { print last }' \
    "$out/run/metrics.csv")
awk -F, -v trained="$trained" 'NR == 1 || $1 <= trained' "$out/memory.csv" > "$out/memory.part" && mv "$out/memory.part" "$out/memory.csv"

# Mean, slope (least squares) and its standard error of a column over the first one, without the first quarter.
fit() {
    awk -F, -v y="$2" -v name="$3" -v unit="$4" '
        NR > 1 && $y != "" { n++; xs[n] = $1; ys[n] = $y }
        END {
            from = xs[1] + (xs[n] - xs[1]) / 4
            for (i = 1; i <= n; i++) if (xs[i] >= from) { m++; x[m] = xs[i]; v[m] = ys[i]; sx += xs[i]; sy += ys[i] }
            if (m < 3) exit
            mx = sx / m; my = sy / m
            for (i = 1; i <= m; i++) { sxx += (x[i] - mx) ^ 2; sxy += (x[i] - mx) * (v[i] - my) }
            slope = sxy / sxx
            for (i = 1; i <= m; i++) rss += (v[i] - my - slope * (x[i] - mx)) ^ 2
            error = sqrt(rss / (m - 2) / sxx)
            length_x = x[m] - x[1]
            change = slope * length_x; change_error = error * length_x
            size = change < 0 ? -change : change
            verdict = size <= 2 * change_error || size < 0.02 * my ? "flat" : change > 0 ? "GROWS" : "falls"
            printf "| %s | %.2f %s | %+.3f +- %.3f %s | %+.2f %% | %s |\n", name, my, unit, change, change_error, unit, 100 * change / my, verdict
        }' "$1"
}
echo "| $steps steps on $backend | mean | change from a quarter to the end | share | |"
echo "|---|---|---|---|---|"
fit "$out/memory.csv" 2 "memory of the process" MB
fit "$out/memory.csv" 3 "memory of the card" MB
fit "$out/pace.csv" 2 "wall time per step" ms
fit "$out/pace.csv" 3 "CPU time per step" ms
