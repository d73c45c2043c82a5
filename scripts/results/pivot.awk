# One figure of a table of `dvr bench`: a row per method, a column per scene that has the figure.
#
#     awk -v figure='Chamfer-L1' -f pivot.awk table.md
BEGIN { FS = " *\\| *" }
/^\| scene / { for (i = 2; i < NF; i++) place[$i] = i; next }
/^\|---/ || !/^\|/ { next }
{
    scene = $(place["scene"])
    method = $(place["method"])
    if (!(scene in scene_seen)) { scene_seen[scene] = 1; scene_names[++scenes] = scene }
    if (!(method in method_seen)) { method_seen[method] = 1; method_names[++methods] = method }
    value[method, scene] = (figure in place) ? $(place[figure]) : ""
    if (value[method, scene] != "") has[scene] = 1
}
END {
    printf "| |"
    for (s = 1; s <= scenes; s++) if (scene_names[s] in has) printf " %s |", scene_names[s]
    printf "\n|---|"
    for (s = 1; s <= scenes; s++) if (scene_names[s] in has) printf "---|"
    printf "\n"
    for (m = 1; m <= methods; m++) {
        printf "| %s |", method_names[m]
        for (s = 1; s <= scenes; s++) if (scene_names[s] in has) printf " %s |", value[method_names[m], scene_names[s]]
        printf "\n"
    }
}
