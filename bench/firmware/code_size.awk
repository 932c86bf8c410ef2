# Bytes of code that each block's process reaches, from the table's object, and what it may call
# outside: memory moves and the compiler's arithmetic, no mathematics library, no system.
#   nm -S OBJECT > symbols; objdump -dr OBJECT > code; awk -f code_size.awk symbols code
# Prints `block,bytes`. Status 1 names each block that calls anything else.

FNR == NR {
  if (NF == 4 && $3 ~ /^[tTwW]$/) size[$4] = hex($2)
  next
}
/^[0-9a-f]+ <.*>:$/ {
  caller = $2
  gsub(/[<>:]/, "", caller)
}
/R_ARM_(THM_CALL|THM_JUMP|CALL|JUMP)/ {
  callee = $3
  sub(/[+-]0x[0-9a-f]+$/, "", callee)
  calls[caller] = calls[caller] " " callee
}
END {
  for (symbol in size)
    if (match(symbol, /stepINS_[0-9]+[A-Za-z]+CaseI/)) {
      name = substr(symbol, RSTART, RLENGTH)
      gsub(/^stepINS_[0-9]+|CaseI$/, "", name)
      block = snake(name)
      split("", seen)
      print block "," reach(symbol)
      blocks++
    }
  if (blocks == 0) {
    print "no block found in the object" > "/dev/stderr"
    wrong = 1
  }
  exit wrong
}

# Size of a function and all that it calls, each counted once.
function reach(symbol,    bytes, list, n, i) {
  if (symbol in seen) return 0
  seen[symbol] = 1
  if (!(symbol in size)) {
    if (symbol !~ /^(mem(cpy|set|move)|__aeabi_.*|sqrtf?)$/) {
      print "forbidden in " block ": " symbol > "/dev/stderr"
      wrong = 1
    }
    return 0
  }
  bytes = size[symbol]
  n = split(calls[symbol], list, " ")
  for (i = 1; i <= n; ++i) bytes += reach(list[i])
  return bytes
}

function snake(name,    i, c, out) {
  for (i = 1; i <= length(name); ++i) {
    c = substr(name, i, 1)
    out = out (c ~ /[A-Z]/ && i > 1 ? "_" : "") tolower(c)
  }
  return out
}

function hex(text,    i, value) {
  text = tolower(text)
  for (i = 1; i <= length(text); ++i)
    value = 16 * value + index("0123456789abcdef", substr(text, i, 1)) - 1
  return value
}
