# The parts of scripts/results.sh: what each makes, how long it takes, and how. Read by that script, which sets root, out, write and DVR.

PARTS="demo renders depth speed ablations ablations-photographs paper photographs stress stress-masks stress-cameras stress-photographs stress-network \
furniture objects camera-refinement step soak"

# Minutes on two cores, measured or summed up from the tables.
minutes_of() {
    case $1 in
        demo) echo 1 ;;
        renders) echo 5 ;;
        depth) echo 1 ;;
        speed) echo 8 ;;
        ablations) echo 20 ;;
        ablations-photographs) echo 60 ;;
        paper) echo 90 ;;
        photographs) echo 60 ;;
        stress) echo 25 ;;
        stress-masks) echo 8 ;;
        stress-cameras) echo 10 ;;
        stress-photographs) echo 25 ;;
        stress-network) echo 30 ;;
        furniture) echo 8 ;;
        objects) echo 240 ;;
        camera-refinement) echo 10 ;;
        step) echo 5 ;;
        soak) echo 35 ;;
    esac
}

makes() {
    case $1 in
        demo) echo "the demo's rows of the README" ;;
        renders) echo "docs/results/renders.md and the README's table" ;;
        depth) echo "docs/results/depth.md" ;;
        speed) echo "docs/results/speed_and_size.md with its charts" ;;
        ablations) echo "docs/results/ablations.md, renders and plane sweep" ;;
        ablations-photographs) echo "docs/results/ablations.md, photographs" ;;
        paper) echo "docs/results/paper.md" ;;
        photographs) echo "docs/results/photographs.md and the README's table" ;;
        stress) echo "docs/results/stress.md with its charts" ;;
        stress-masks) echo "docs/results/stress_masks.md with its charts" ;;
        stress-cameras) echo "docs/results/stress_cameras.md with its charts" ;;
        stress-photographs) echo "docs/results/stress_photographs.md with its charts" ;;
        stress-network) echo "docs/results/stress_network.md" ;;
        furniture) echo "docs/results/furniture_scenes.md" ;;
        objects) echo "docs/results/objects.md" ;;
        camera-refinement) echo "docs/results/camera_refinement.md" ;;
        step) echo "docs/results/step.md" ;;
        soak) echo "docs/results/soak.md" ;;
    esac
}

# Seeds of each figure; pages have three.
SEEDS=${DVR_SEEDS:-3}

# Photographs that networks are measured on, and those whose shape is known, by points or by truth, for ablations.
PHOTOGRAPHS="dino_sparse_ring temple_sparse_ring nerf_chair dtu_scan65"
KNOWN_SHAPES="dtu_scan65 photoreal/bronze photoreal/plastic photoreal/exposure"

# All photographs and photoreal renders in their own size, and those that are also measured at half of it, or only so.
WHOLE="$PHOTOGRAPHS dtu_scan24 photoreal/bronze photoreal/plastic photoreal/exposure photoreal/desk_truth"
HALVED="dtu_scan24 nerd_head"

# Points that were verified on photographs lie under this name in the folders of scenes that have some.
POINTS=verified_points.npz

# Folders in DVR_SCENES that a part is made of.
scenes_of() {
    case $1 in
        photographs) echo "$WHOLE nerd_head" ;;
        ablations-photographs) echo "$KNOWN_SHAPES" ;;
    esac
}

# Whether a part can be made of some of its scenes.
takes_some() {
    [ "$1" = photographs ]
}

# Those of some folders of DVR_SCENES that are there, with their paths.
there() {
    for scene in "$@"; do
        [ ! -e "${DVR_SCENES:-/nonexistent}/$scene" ] || printf '%s ' "$DVR_SCENES/$scene"
    done
}

# Arguments that measure by verified points, where one of some scenes has them.
points_of() { # SCENE...
    for scene in "$@"; do
        [ ! -f "$scene/$POINTS" ] || { echo "--points $POINTS"; return; }
    done
}

# Puts a block into its page, if it has one and pages are to be written.
insert() { # PAGE NAME
    [ "$write" = yes ] && [ "$1" != - ] || return 0
    awk -v name="$2" -v file="$out/blocks/$2.md" -f "$root/scripts/results/insert.awk" "$1" > "$out/page.part" ||
        { echo "$1 has no marks <!-- results:$2 -->" >&2; exit 1; }
    cp "$out/page.part" "$1"
}

# A file of results that lies beside the pages.
publish() { # FILE NAME
    [ "$write" = yes ] || return 0
    mkdir -p "$(dirname "docs/results/$2")"
    cp "$1" "docs/results/$2"
}

# A block of a table and the command that made it.
block() { # NAME PAGE TABLE COMMAND
    printf '%s\n\n```sh\n%s\n```\n' "$(cat "$3")" "$4" > "$out/blocks/$1.md"
    insert "$2" "$1"
}

# A benchmark: block, page, then the arguments of `dvr bench`. A run that fails is a row of its table.
bench() { # NAME PAGE ARGUMENT...
    name=$1 page=$2
    shift 2
    "$DVR" bench "$@" --out "$out/$name" || [ $? -eq 1 ]
    block "$name" "$page" "$out/$name/table.md" "dvr bench $(shown "$@") --out DIR"
    [ "$page" = - ] || publish "$out/$name/results.csv" "$name.csv"
}

stress() { # NAME PAGE ARGUMENT...
    name=$1 page=$2
    shift 2
    "$DVR" stress --out "$out/$name" "$@"
    # Break points first; the axes one by one further down the page, each with its chart.
    awk '/^### / { exit } { print }' "$out/$name/table.md" > "$out/$name/points.md"
    block "$name" "$page" "$out/$name/points.md" "dvr stress --out DIR $(shown "$@")"
    awk -v prefix="${chart_prefix:-}" -f scripts/results/axes.awk "$out/$name/table.md" > "$out/blocks/${name}_axes.md"
    insert "$page" "${name}_axes"
    publish "$out/$name/results.csv" "$name.csv"
}

# Arguments as they are typed, without this machine's folders.
shown() {
    for argument in "$@"; do
        case $argument in *[!A-Za-z0-9_./,:=+-]*) argument="'$argument'" ;; esac
        printf '%s ' "$argument"
    done | sed "s#$out/##g; s#$root/##g; s#${DVR_SCENES:-/nonexistent}/##g; s#${DVR_BEFORE:-/nonexistent}#OLD/dvr#g; s# \$##"
}

# Puts pictures in front of the table of a block.
illustrate() { # NAME PAGE FILE...
    block=$out/blocks/$1.md name=$1 page=$2
    shift 2
    { for file in "$@"; do echo "![$(echo "$file" | tr - ' ')](charts/$file.svg)"; done; echo; cat "$block"; } > "$block.part"
    mv "$block.part" "$block"
    insert "$page" "$name"
    charts "$name" "$@"
}

charts() { # NAME FILE...
    name=$1
    shift
    for file in "$@"; do
        publish "$out/$name/charts/$file.svg" "charts/$file.svg"
    done
}

# Removes folders that another commit made: scenes are made at the commit that is measured.
of_this_commit() { # STAMP FOLDER...
    stamp=$out/$1.made
    shift
    [ "$(cat "$stamp" 2> /dev/null)" != "$version" ] || return 0
    [ ! -f "$stamp" ] || for folder in "$@"; do rm -rf "${out:?}/$folder"; done
    echo "$version" > "$stamp"
}

# The shapes of the benchmark, rendered at 64 and at 128 pixels; what is there is kept.
render_shapes() {
    of_this_commit scenes shapes scenes
    [ -f "$out/shapes/README.txt" ] || cargo run --release -q -p dvr-core --example make_shapes -- "$out/shapes"
    for size in 64 128; do
        "$DVR" synth "$out"/shapes/*.ply --category "res$size" --size "$size" --out "$out/scenes"
    done
    R64="$out/scenes/res64/blob $out/scenes/res64/sharp $out/scenes/res64/plate $out/scenes/res64/rods"
    R128="$out/scenes/res128/blob $out/scenes/res128/sharp $out/scenes/res128/plate $out/scenes/res128/rods"
}

# Scenes of the README's table.
README_SCENES='^(res128.*|mug|dino_sparse_ring|dtu_scan65)$'

# The README's table: of all benchmarks of it that were made.
readme() {
    set --
    for name in renders photographs; do
        [ ! -f "$out/$name/table.md" ] || set -- "$@" "$out/$name/table.md"
    done
    [ $# -gt 0 ] || set -- "$out/demo/table.md"
    { head -n 1 "$1"; echo; awk -v only="$README_SCENES" -f scripts/results/summary.awk "$@"; } > "$out/blocks/readme.md"
    insert README.md readme
}

part_demo() {
    bench demo - assets/scenes/mug --methods hull,grid --seeds "$SEEDS"
    readme
}

part_renders() {
    render_shapes
    bench renders docs/results/renders.md $R64 $R128 assets/scenes/mug --methods hull,grid --seeds "$SEEDS"
    readme
}

part_depth() {
    render_shapes
    bench depth docs/results/depth.md $R64 --methods grid --supervision depth --seeds "$SEEDS"
}

part_speed() {
    render_shapes
    bench speed_and_size docs/results/speed_and_size.md "$out/scenes/res64/blob" "$out/scenes/res64/sharp" \
        --methods hull,grid,network,classic --seeds 1 --follow-shape \
        --variant 'cells-32:capacity={"cells":32}' --variant 'cells-128:capacity={"cells":128}'
    illustrate speed_and_size docs/results/speed_and_size.md blob-chamfer-l1-during-training sharp-chamfer-l1-during-training \
        blob-chamfer-l1-against-cpu-time sharp-chamfer-l1-against-cpu-time blob-chamfer-l1-against-size sharp-chamfer-l1-against-size
}

# The variants of the ablations, beside a setting that all share.
ablate() { # NAME FIGURES SETTINGS FLAT SCENE...
    name=$1 figures=$2 shared=$3 flat=$4
    shift 4
    bench "$name" - "$@" $(points_of "$@") --methods hull --seeds "$SEEDS" \
        --variant "base:$shared" \
        --variant "no-photo-consistency:$shared,losses.photo_consistency.weight=0" \
        --variant "no-patch-ncc:$shared,losses.patch_ncc.weight=0" \
        --variant "no-smoothness:$shared,losses.smoothness.weight=0" \
        --variant "detached-color:$shared,losses.color.weight=0,losses.detached_color.weight=1" \
        --variant "no-sweep:$shared,plane_sweep_pixels=0" \
        --variant "no-stereo:$shared,stereo_cells=0" \
        --variant "full-color:$shared,trusts_colors=full" \
        --variant "no-exposure:$shared,exposure=off" \
        --variant "no-further-passes:$shared,further_passes=0" \
        --variant "no-growth:$shared,$flat" \
        --variant "few-levels:$shared,coarsest_cells=16,$flat"
    { head -n 1 "$out/$name/table.md"; for figure in $figures; do
        printf '\n**%s**\n\n' "$(echo "$figure" | tr _ ' ')"
        awk -v figure="$(echo "$figure" | tr _ ' ')" -f scripts/results/pivot.awk "$out/$name/table.md"
    done; } > "$out/blocks/$name.md"
    insert docs/results/ablations.md "$name"
    publish "$out/$name/results.csv" "$name.csv"
}

part_ablations() {
    render_shapes
    ablate ablations_renders "Chamfer-L1 normals CPU,_s" 'capacity={"cells":64}' first_cells=64,steps=600 $R64
    stress ablations_sweep docs/results/ablations.md --axis bowl-depth,texture-contrast,texture-repeats --methods hull,grid \
        --seeds "$SEEDS" --variant off:plane_sweep_pixels=0
}

part_ablations_photographs() {
    ablate ablations_photographs "points:_mean points:_median Chamfer-L1 normals volume_IoU test_PSNR,_dB CPU,_s" \
        'capacity={"cells":128}' first_cells=128,steps=900 $(there $KNOWN_SHAPES)
}

part_paper() {
    render_shapes
    for table in samples smoothness depth; do
        name=paper_$table
        "$DVR" paper --table "$table" --data "$out/scenes/res64/blob" "$out/scenes/res64/sharp" --out "$out/$name" || [ $? -eq 1 ]
        block "$name" docs/results/paper.md "$out/$name/table.md" \
            "dvr paper --table $table --data scenes/res64/blob scenes/res64/sharp --out DIR"
        publish "$out/$name/results.csv" "$name.csv"
    done
}

# A benchmark of scenes in DVR_SCENES, as far as they are there; with verified points where one of them has some.
bench_there() { # NAME SCENES ARGUMENT...
    name=$1 found=$(there $2)
    shift 2
    [ -n "$found" ] || return 0
    bench "$name" docs/results/photographs.md $found "$@" $(points_of $found)
}

part_photographs() {
    bench_there photographs "$WHOLE" --methods hull,grid --seeds "$SEEDS"
    bench_there photographs_half "$HALVED" --methods hull,grid --seeds "$SEEDS" --downscale 2
    bench_there photographs_networks "$PHOTOGRAPHS" --methods network,classic --seeds 1 --time 110s
    readme
}

part_stress() {
    stress stress docs/results/stress.md --methods hull,grid --seeds "$SEEDS" --axis shape,texture,views,pictures,gradients
    for chart in "$out"/stress/charts/*.svg; do charts stress "$(basename "$chart" .svg)"; done
}

part_stress_masks() {
    stress stress_masks docs/results/stress_masks.md --methods hull,grid --seeds "$SEEDS" --axis masks
    for chart in "$out"/stress_masks/charts/*.svg; do charts stress_masks "$(basename "$chart" .svg)"; done
}

part_stress_cameras() {
    stress stress_cameras docs/results/stress_cameras.md --methods hull,grid --seeds "$SEEDS" --axis cameras --variant refined:refine_cameras=10
    for chart in "$out"/stress_cameras/charts/*.svg; do charts stress_cameras "$(basename "$chart" .svg)"; done
}

part_stress_photographs() {
    # Some of its axes are those of another page, without the earlier build.
    chart_prefix=photographs-
    stress stress_photographs docs/results/stress_photographs.md --methods hull,grid --seeds "$SEEDS" --axis photographs,exposure,cut,one-sided \
        ${DVR_BEFORE:+--variant "before:program=$DVR_BEFORE"}
    for chart in "$out"/stress_photographs/charts/*.svg; do publish "$chart" "charts/$chart_prefix$(basename "$chart")"; done
    chart_prefix=
}

part_stress_network() {
    stress stress_network docs/results/stress_network.md --axis shape,texture,views,masks,cameras,pictures --methods hull,grid,classic \
        --against grid
}

part_furniture() {
    of_this_commit furniture furniture/data furniture_scenes/data
    DVR=$DVR sh scripts/furniture.sh "$out/furniture"
    DVR=$DVR sh scripts/furniture_scenes.sh "$out/furniture" "$out/furniture_scenes" --seeds "$SEEDS" || [ $? -eq 1 ]
    block furniture_scenes docs/results/furniture_scenes.md "$out/furniture_scenes/bench/table.md" \
        "scripts/furniture.sh furniture && scripts/furniture_scenes.sh furniture DIR --seeds $SEEDS"
    publish "$out/furniture_scenes/bench/results.csv" furniture_scenes.csv
}

part_objects() {
    of_this_commit furniture furniture/data furniture_scenes/data
    DVR=$DVR sh scripts/furniture.sh "$out/furniture"
    # A row that fails says so in the table. Three seeds take a night.
    "$DVR" paper --table shapenet --data "$out/furniture/data" --out "$out/objects" --seeds 1 || [ $? -eq 1 ]
    block objects docs/results/objects.md "$out/objects/table.md" \
        "scripts/furniture.sh furniture && dvr paper --table shapenet --data furniture/data --out DIR"
    publish "$out/objects/table.csv" objects.csv
}

# What a program prints, with where it ran.
printed() { # NAME PAGE COMMAND...
    name=$1 page=$2
    shift 2
    mkdir -p "$out/$name"
    stamp="$version $*"
    if [ "$(cat "$out/$name/made" 2> /dev/null)" != "$stamp" ]; then
        { origin; echo; "$@"; } > "$out/$name/table.part"
        mv "$out/$name/table.part" "$out/$name/table.md"
        echo "$stamp" > "$out/$name/made"
    fi
    block "$name" "$page" "$out/$name/table.md" "$(shown "$@")"
}

# Machine and program of tables that `dvr` itself does not print.
origin() {
    cpu=$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo 2> /dev/null | head -n 1)
    echo "${cpu:-$(uname -m)}, $(getconf _NPROCESSORS_ONLN) cores, $version."
}

part_camera_refinement() {
    render_shapes
    printed camera_refinement docs/results/camera_refinement.md \
        cargo bench -q -p dvr-train --bench camera_refinement -- "$out/scenes/res128/blob" --seeds "$SEEDS"
}

part_step() {
    # Photographs beside the demo, where they are there.
    printed step docs/results/step.md \
        cargo bench -q -p dvr-grid --bench step -- "$root/assets/scenes/mug/mug" $(there dtu_scan65)
}

part_soak() {
    export DVR
    printed soak_cpu docs/results/soak.md sh scripts/soak.sh cpu 20000 "$out/soak_cpu/run"
    printed soak_gpu docs/results/soak.md env METHOD=grid sh scripts/soak.sh gpu 20000 "$out/soak_gpu/run"
}
