# Puts a file between the marks `<!-- results:NAME -->` and `<!-- /results:NAME -->` of a page, in place of what is there.
#
#     awk -v name=NAME -v file=BLOCK -f insert.awk PAGE
#
# Exit code 3 where the page has no such marks.
BEGIN { open = "<!-- results:" name " -->"; close_ = "<!-- /results:" name " -->" }
$0 == open {
    print
    found = 1
    inside = 1
    while ((getline line < file) > 0) print line
    next
}
$0 == close_ { inside = 0 }
!inside { print }
END { if (!found || inside) exit 3 }
