#!/bin/sh
# Stands for `dvr` in tests of scripts/results.sh: leaves files of the right names and forms, and writes down how it was called.
echo "$*" >> "${CALLS:?}"
command=$1
out=
scenes=
previous=
for argument in "$@"; do
    [ "$previous" != --out ] || out=$argument
    case $argument in */res64/* | */res128/* | */mug | */dino_* | */temple_* | */nerf_* | */dtu_* | */photoreal/* | */nerd_*) scenes="$scenes $(basename "$argument")" ;; esac
    previous=$argument
done
case $command in
    --version) echo "dvr 9.9 (${STUB_COMMIT:-abcdef012})" ;;
    bench)
        mkdir -p "$out/charts"
        {
            printf 'A CPU, dvr 9.9 (abcdef012). Median over seeds (range).\n\n'
            echo "| scene | from | method | seeds | whole job, s | training, s | CPU, s | stored kB | Chamfer-L1 | floor | normals | test PSNR, dB | silhouette IoU |"
            echo "|---|---|---|---|---|---|---|---|---|---|---|---|---|"
            for scene in $scenes; do
                for method in hull grid; do
                    echo "| $scene | rgb | $method | 3 of 3 | 2.0 (1.0-3.0) | 1.00 | 3.0 | 20 | 0.0030 | 0.0020 | 0.900 | 25.00 | 0.9000 |"
                done
            done
        } > "$out/table.md"
        echo scene > "$out/results.csv"
        for scene in $scenes; do
            for chart in during-training against-cpu-time against-size; do echo svg > "$out/charts/$scene-chamfer-l1-$chart.svg"; done
        done
        [ -z "${STUB_FAILS:-}" ] || exit 1
        ;;
    stress)
        mkdir -p "$out/charts"
        {
            printf 'A CPU, dvr 9.9 (abcdef012).\n\n| breaks at | unit | tested | grid |\n|---|---|---|---|\n| views | views | 24 | holds: 3 of 3 |\n'
            printf '\n### views (views)\n\nfew views.\n\n| views | grid |\n|---|---|\n| 24 | 0.010 |\n'
        } > "$out/table.md"
        echo axis > "$out/results.csv"
        echo svg > "$out/charts/views.svg"
        ;;
    paper)
        mkdir -p "$out"
        printf 'table of objects\n' > "$out/table.md"
        echo row > "$out/table.csv"
        echo row > "$out/results.csv"
        ;;
    train) mkdir -p "$out" ;;
    synth) mkdir -p "$out" ;;
esac
