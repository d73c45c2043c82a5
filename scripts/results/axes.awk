# The axes of a table of `dvr stress`, one by one, each with a link to its chart, whose file's name begins with `prefix`.
#
#     awk -v prefix=photographs- -f axes.awk table.md
/^\| breaks at/ { shown = 0 }
/^### / { shown = 1; axis = $2; linked = 0 }
!shown { next }
!linked && /\.$/ { sub(/\.$/, " ([chart](charts/" prefix axis ".svg)).") ; linked = 1 }
{ print }
