# Holds counted instructions against the stored table.
#   awk -v core=m4 -f compare.awk instructions.csv counted.csv
# Mean, worst and code size may differ by 5 % either way. Status 1 when one grew by more, when one
# shrank by more (so that a gain is kept: update the table), or when a block is only in one of both.
BEGIN { FS = "," }
/^#/ || /^block,/ || $2 != core { next }
FNR == NR {
  mean[$1] = $3
  worst[$1] = $4
  bytes[$1] = $5
  next
}
{
  if (!($1 in mean)) {
    say($1 " is not in the table: update the table")
    next
  }
  hold($1, "mean", mean[$1], $3)
  hold($1, "worst sample", worst[$1], $4)
  hold($1, "code bytes", bytes[$1], $5)
  counted[$1] = 1
}
END {
  for (block in mean)
    if (!(block in counted)) say(block " is in the table but was not counted: update the table")
  exit wrong
}
function hold(block, what, old, new) {
  if (new > 1.05 * old) say(block ": " what " grew from " old " to " new)
  if (new < 0.95 * old) say(block ": " what " fell from " old " to " new ": update the table")
}
function say(text) {
  print core " " text
  wrong = 1
}
