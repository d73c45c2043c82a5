#!/bin/sh
# A ShapeNet-like dataset of furniture: about 360 objects in 12 categories, split by object, ready for `dvr train`.
#
#     scripts/furniture.sh OUT [further arguments of `dvr synth`]
#
# The meshes are those of the Debian package `sweethome3d-furniture` (Creative Commons, CC0 or BY 3.0 by model; see its copyright file), which is
# downloaded but not installed. Needs apt-get, dpkg-deb, unzip, and `dvr` on the PATH (or in $DVR). An interrupted run goes on when it is
# started again: objects that are there are kept. OUT/meshes holds the unpacked models, OUT/data the dataset.
set -eu

[ $# -ge 1 ] || { sed -n '2,8s/^# \{0,1\}//p' "$0" >&2; exit 2; }
out=$1
shift
dvr=${DVR:-dvr}
packages=$out/package
mkdir -p "$packages" "$out/meshes"

if [ ! -d "$packages/usr" ]; then
    # Not installed: nothing outside of OUT is touched.
    (cd "$packages" && apt-get download sweethome3d-furniture)
    dpkg-deb -x "$packages"/sweethome3d-furniture_*.deb "$packages"
fi

# Lines `category <tab> path of the OBJ file` for the models of a catalogue that belong to one of the categories.
select_models() {
    awk '
    function category(name, group) {
        name = tolower(name)
        if (group == "Characters") return name ~ /male|boy|girl/ ? "person" : ""
        if (group == "Doors and windows") return name ~ /window/ ? "window" : (name ~ /door/ ? "door" : "")
        if (group == "Lights") return name ~ /lamp|light/ ? "lamp" : ""
        if (name ~ /lamp/) return "lamp"
        if (group == "Vehicles") return name ~ /car$|sedan|suv|truck|bus$|van$|beetle|chevrolet/ ? "car" : ""
        if (name ~ /chair|stool|ottoman/) return "chair"
        if (name ~ /sofa|couch|futon|(^|painted |concrete )bench$/) return "sofa"
        if (name ~ /(^| )bed$|^crib$/) return "bed"
        if (name ~ /cabinet|wardrobe|cupboard|bookcase|shelves|^chest|dresser|fridge|refrigerator|locker|oven$|washing|cooker$|vanity/) return "cabinet"
        if (name ~ /(^| )(table|desk)($| on| with)/ && name !~ /football|pool/) return "table"
        if (name ~ /bottle|vase|(^| )(cup|mug|glass|jar|bowl|pot)$|teapot/) return "vessel"
        if (name ~ /sink$|basin$|toilets|^bath$|bathtub|bidet|urinal|jacuzzi|island bath/) return "bathroom"
        return ""
    }
    { sub(/\r$/, "") }
    match($0, /^[a-zA-Z]+#[0-9]+[ ]*=/) {
        split($0, part, "#")
        number = part[2] + 0
        value = $0
        sub(/^[^=]*=[ ]*/, "", value)
        if (part[1] == "name") name[number] = value
        if (part[1] == "category") group[number] = value
        if (part[1] == "model") model[number] = value
    }
    END {
        for (i in model) {
            found = category(name[i], group[i])
            if (found != "") print found "\t" substr(model[i], 2)
        }
    }'
}

for pack in "$packages"/usr/share/sweethome3d/furniture/*.sh3f; do
    unzip -p "$pack" PluginFurnitureCatalog.properties | select_models | while read -r category model; do
        name=$(basename "$pack" .sh3f)_$(basename "$model" .obj)
        folder=$out/meshes/$category/$name
        [ -f "$folder/$name.obj" ] && continue
        mkdir -p "$folder"
        # Materials and textures lie beside the mesh and keep their names; the mesh is renamed.
        unzip -q -o -j "$pack" "$(dirname "$model")/*" -d "$folder"
        mv "$folder/$(basename "$model")" "$folder/$name.obj"
    done
done

# Views from all sides (the default): a side that no view sees has no defined shape.
for category in "$out"/meshes/*; do
    "$dvr" synth "$category"/*/*.obj --category "$(basename "$category")" --out "$out/data" "$@"
done
