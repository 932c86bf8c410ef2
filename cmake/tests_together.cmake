# Writes a translation unit of several tests: first all that they include, then each in a namespace
# of its own, so that two may use the same name. Headers are read once, which is most of the work.
#   cmake -DSOURCES="room/test_a.cpp;room/test_b.cpp" -DUNIT=FILE -P tests_together.cmake
set(includes "#include \"together.hpp\"")
set(tests)
foreach(source ${SOURCES})
  file(STRINGS ${source} lines REGEX "^#include ")
  list(APPEND includes ${lines})
  cmake_path(GET source STEM name)
  string(REPLACE "test_" "" block ${name})
  string(APPEND tests "namespace ${name} {\n#include \"${source}\"\n}\n"
    "static const check::Test entry_${block}(\"${block}\", ${name}::main);\n")
endforeach()
list(REMOVE_DUPLICATES includes)
list(JOIN includes "\n" includes)
file(WRITE ${UNIT} "${includes}\n${tests}")
