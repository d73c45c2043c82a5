# The README's table of a table of `dvr bench`: one row per scene, the grid beside the visual hull.
#
#     awk -v only=PATTERN -f summary.awk table.md...
BEGIN {
    FS = " *\\| *"
    columns = split("seeds,training; s,whole job; s,Chamfer-L1,floor,test PSNR; dB,stored kB", wanted, ",")
    for (i = 1; i <= columns; i++) gsub(";", ",", wanted[i])
    printf "| scene | seeds | training, s | whole job, s | Chamfer-L1 | floor | test PSNR, dB | stored kB | hull: Chamfer-L1 | hull: PSNR, dB |\n"
    printf "|---|---|---|---|---|---|---|---|---|---|\n"
}
# A first paragraph that all tables share is theirs; each table has columns of its own.
/^\| scene / { delete place; for (i = 2; i < NF; i++) place[$i] = i; next }
/^\|---/ || !/^\|/ { next }
{
    scene = $(place["scene"])
    method = $(place["method"])
    if (!(scene in seen)) { seen[scene] = 1; order[++scenes] = scene }
    for (i = 1; i <= columns; i++) figure[scene, method, i] = (wanted[i] in place) ? $(place[wanted[i]]) : ""
}
END {
    for (s = 1; s <= scenes; s++) {
        scene = order[s]
        if (!((scene, "grid", 1) in figure) || scene !~ only) continue
        printf "| %s |", scene
        for (i = 1; i <= columns; i++) printf " %s |", figure[scene, "grid", i]
        printf " %s | %s |\n", figure[scene, "hull", 4], figure[scene, "hull", 6]
    }
}
