#!/bin/sh
# Symbol gate: an object of real-time blocks must neither hold nor need the heap, exceptions, RTTI
# or guarded statics. Prints what it found; status 1 when there is any.
#   symbols.sh NM OBJECT...
set -u
nm=$1
shift
[ $# -gt 0 ] || { echo "symbols.sh: no object given" >&2; exit 2; }
for object in "$@"; do
  list=$("$nm" "$object") || exit 2
  [ -n "$list" ] || { echo "$object: no symbols" >&2; exit 2; }
  # operator new and delete; the C heap; exceptions, guards, atexit; type information; tables of
  # virtual functions; throwing helpers of the standard library; dynamic casts.
  printf '%s\n' "$list" | awk -v object="$(basename "$object")" '
    $NF ~ /^(_Zn[wa]|_Zd[la])/ ||
    $NF ~ /^_*(malloc|calloc|realloc|free|memalign|aligned_alloc|posix_memalign|sbrk)(_r)?$/ ||
    $NF ~ /^(__cxa_|__aeabi_atexit|__gxx_personality|_Unwind_|__dynamic_cast|_ZTI|_ZTS|_ZTV)/ ||
    $NF ~ /__throw_/ || $NF ~ /^(abort|atexit|exit|printf|puts|pthread_)/ {
      print object ": forbidden symbol " $NF
      found = 1
    }
    END { exit found }' || status=1
done
exit ${status:-0}
