# Warnings of the house, and one way to declare a test, an example or a fuzz target.

function(servosense_warnings target)
  target_compile_options(${target} PRIVATE
    -Wall -Wextra -Wconversion -Wshadow -Wdouble-promotion
    # g++ 12 reports std::string concatenation as overlapping memcpy (GCC bug 105651).
    $<$<AND:$<CXX_COMPILER_ID:GNU>,$<VERSION_LESS:$<CXX_COMPILER_VERSION>,13>>:-Wno-restrict>
    $<$<BOOL:${SERVOSENSE_WERROR}>:-Werror>)
endfunction()

# servosense_batches(<count> <batches>): into how few batches of at most 26 files so many are parted.
function(servosense_batches count batches)
  math(EXPR parts "(${count} + 25) / 26")
  set(${batches} ${parts} PARENT_SCOPE)
endfunction()

# servosense_together(<target> <room>...): the files of each room in batches of equal size, because to read the
# headers, and to compile what they instantiate, takes longer than what follows (of `cli` by eights: 149 s, so:
# 109 s). No two of a room may use a name of their own twice.
function(servosense_together target)
  set_target_properties(${target} PROPERTIES UNITY_BUILD ${SERVOSENSE_UNITY} UNITY_BUILD_MODE GROUP)
  foreach(room ${ARGN})
    get_target_property(sources ${target} SOURCES)
    list(FILTER sources INCLUDE REGEX "/src/${room}/")
    # They know the list of effects: tests/reconcile/effect_page.sh has others in their place.
    set(effects ${sources})
    list(FILTER effects INCLUDE REGEX "/drive/(candidates/.*|response|backlash_response)[.]cpp$|/sim/drive_simulator[.]cpp$")
    # A class declared in a header has members of an unnamed namespace: g++ takes files compiled together for
    # headers (-Wsubobject-linkage).
    set(alone ${sources})
    list(FILTER alone INCLUDE REGEX "/(milling_layered_cut|chatter_reach|shdr_server|reference_distance)[.]cpp$")
    list(REMOVE_ITEM sources ${effects} ${alone} "")
    set_source_files_properties(${effects} PROPERTIES UNITY_GROUP ${room}_effects)
    list(LENGTH sources count)
    servosense_batches(${count} batches)
    set(at 0)
    foreach(source ${sources})
      math(EXPR batch "${at} * ${batches} / ${count}")
      math(EXPR at "${at} + 1")
      set_source_files_properties(${source} PROPERTIES UNITY_GROUP ${room}_${batch})
    endforeach()
  endforeach()
endfunction()

# servosense_test_program(<target> <source>...): what every program of tests has in common.
function(servosense_test_program target)
  add_executable(${target} ${ARGN})
  target_include_directories(${target} PRIVATE ${PROJECT_SOURCE_DIR}/tests ${PROJECT_SOURCE_DIR}/src)
  if(TARGET servosense_hal)
    target_link_libraries(${target} PRIVATE servosense_hal)
  else()
    target_link_libraries(${target} PRIVATE servosense)
  endif()
  servosense_warnings(${target})
  # Half the time to compile; what has to be fast lies in the library and in bench/.
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
  if(TARGET servosense_cli)
    add_dependencies(${target} servosense_cli)
  endif()
endfunction()

set(SERVOSENSE_TEST_TIMEOUT_S 600 CACHE STRING "Seconds that a test may take")
# servosense_test(<room> <block> <command>...): exit status 77 means skipped. Runs in the source
# folder, so that tests/data is at hand.
function(servosense_test room block)
  add_test(NAME ${room}.${block} COMMAND ${ARGN} WORKING_DIRECTORY ${PROJECT_SOURCE_DIR})
  set_tests_properties(${room}.${block} PROPERTIES SKIP_RETURN_CODE 77
    TIMEOUT ${SERVOSENSE_TEST_TIMEOUT_S})
  if(TARGET servosense_cli)
    set_property(TEST ${room}.${block} PROPERTY ENVIRONMENT
      SERVOSENSE_PROGRAM=$<TARGET_FILE:servosense_cli>)
  endif()
endfunction()

# servosense_room_tests(<room> <room>/test_<block>.cpp...): one program, `test_<room> <block>`, and
# one CTest entry a block. Files are compiled in batches, each file in a namespace of its own.
function(servosense_room_tests room)
  set(target test_${room})
  list(LENGTH ARGN count)
  servosense_batches(${count} batches)
  math(EXPR size "(${count} + ${batches} - 1) / ${batches}")
  if(NOT SERVOSENSE_UNITY)
    set(size 1)
  endif()
  set(units)
  set(sources ${ARGN})
  while(sources)
    list(SUBLIST sources 0 ${size} some)
    list(REMOVE_ITEM sources ${some})
    list(LENGTH units number)
    set(unit ${CMAKE_CURRENT_BINARY_DIR}/together/${room}_${number}.cpp)
    add_custom_command(OUTPUT ${unit} VERBATIM
      COMMAND ${CMAKE_COMMAND} "-DSOURCES=${some}" -DUNIT=${unit}
        -P ${PROJECT_SOURCE_DIR}/cmake/tests_together.cmake
      DEPENDS ${some} ${PROJECT_SOURCE_DIR}/cmake/tests_together.cmake
      WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR})
    list(APPEND units ${unit})
  endwhile()
  servosense_test_program(${target} $<TARGET_OBJECTS:tests_together> ${units})
  # As if each stood in the folder of the room.
  target_compile_options(${target} PRIVATE -iquote ${CMAKE_CURRENT_SOURCE_DIR}/${room})
  foreach(source ${ARGN})
    cmake_path(GET source STEM block)
    string(REPLACE "test_" "" block ${block})
    servosense_test(${room} ${block} ${target} ${block})
  endforeach()
endfunction()

# servosense_fuzz(<parser>): tests/fuzz/fuzz_<parser>.cpp as a libFuzzer target with both sanitizers.
function(servosense_fuzz parser)
  add_executable(fuzz_${parser} fuzz/fuzz_${parser}.cpp)
  target_include_directories(fuzz_${parser} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
  target_link_libraries(fuzz_${parser} PRIVATE servosense $<TARGET_NAME_IF_EXISTS:servosense_hal>)
  target_compile_options(fuzz_${parser} PRIVATE -fsanitize=fuzzer,address,undefined -g -O1)
  target_link_options(fuzz_${parser} PRIVATE -fsanitize=fuzzer,address,undefined)
endfunction()

# servosense_guides_fuzzers(<library>): the fuzzers see which of its branches an input took.
function(servosense_guides_fuzzers library)
  if(SERVOSENSE_FUZZ)
    target_compile_options(${library} PRIVATE -fsanitize=fuzzer-no-link)
    target_link_options(${library} INTERFACE -fsanitize=fuzzer-no-link)
  endif()
endfunction()
