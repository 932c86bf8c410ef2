#!/bin/sh
# The judge of the instruction table, judged: what must fail fails, what must pass passes.
set -u
compare=$(cd "$(dirname "$0")/../../bench/firmware" && pwd)/compare.awk
work=$(mktemp -d)
trap 'rm -r "$work"' EXIT
failures=0

# expect STATUS COUNTED_LINES...: against a table of two blocks on two cores
expect() {
  wanted=$1
  shift
  printf '%s\n' '# compiler' 'block,core,mean,worst,code_bytes' a,m4,100.0,200,1000 \
    b,m4,7.0,7,34 a,m7,50.0,60,900 >"$work/table.csv"
  printf '%s\n' "$@" >"$work/counted.csv"
  awk -v core=m4 -f "$compare" "$work/table.csv" "$work/counted.csv" >"$work/said"
  status=$?
  if [ $status -ne "$wanted" ]; then
    echo "status $status, expected $wanted, for: $*"
    cat "$work/said"
    failures=$((failures + 1))
  fi
}
# expect_said TEXT: of the last comparison
expect_said() {
  grep -q "$1" "$work/said" || { echo "did not say '$1'"; failures=$((failures + 1)); }
}

expect 0 a,m4,100.0,200,1000 b,m4,7.0,7,34
expect 0 a,m4,104.9,209,1049 b,m4,7.0,7,34
expect 0 a,m4,95.1,191,951 b,m4,7.0,7,34
expect 1 a,m4,105.1,200,1000 b,m4,7.0,7,34
expect_said 'mean grew'
expect 1 a,m4,100.0,211,1000 b,m4,7.0,7,34
expect_said 'worst sample grew'
expect 1 a,m4,100.0,200,1051 b,m4,7.0,7,34
expect_said 'code bytes grew'
expect 1 a,m4,94.9,200,1000 b,m4,7.0,7,34
expect_said 'update the table'
expect 1 a,m4,100.0,189,1000 b,m4,7.0,7,34
expect_said 'update the table'
expect 1 a,m4,100.0,200,1000 b,m4,8.0,7,34
expect 1 a,m4,100.0,200,1000
expect_said 'not counted'
expect 1 a,m4,100.0,200,1000 b,m4,7.0,7,34 c,m4,1.0,1,2
expect_said 'not in the table'

[ $failures -eq 0 ] && echo "every case as expected"
exit $((failures > 0))
