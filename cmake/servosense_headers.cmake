# servosense_header_check(<target> [REAL_TIME] HEADERS <header>...): one translation unit a header,
# which must compile by itself and a second time after itself. With REAL_TIME it must not bring in
# what firmware does not have. The headers are named as in `#include "servosense/<header>"`.
function(servosense_header_check target)
  cmake_parse_arguments(check "REAL_TIME" "" "HEADERS" ${ARGN})
  set(units)
  foreach(header ${check_HEADERS})
    set(content "#include \"servosense/${header}\"\n#include \"servosense/${header}\"\n")
    if(check_REAL_TIME)
      # Include guards of libstdc++, libc++ and Eigen.
      string(APPEND content
        "#if defined(_GLIBCXX_STRING) || defined(_GLIBCXX_VECTOR) || defined(_GLIBCXX_IOSTREAM) || \\\n"
        "    defined(_LIBCPP_STRING) || defined(_LIBCPP_VECTOR) || defined(_LIBCPP_IOSTREAM) || \\\n"
        "    defined(EIGEN_CORE_H) || defined(EIGEN_CORE_MODULE_H)\n"
        "#error \"a real-time header includes string, vector, iostream or Eigen\"\n#endif\n")
    endif()
    cmake_path(GET header EXTENSION LAST_ONLY extension)
    if(extension STREQUAL ".h")
      set(suffix .c)
    else()
      set(suffix .cpp)
    endif()
    string(REGEX REPLACE "[/.]" "_" unit ${header})
    set(unit ${CMAKE_CURRENT_BINARY_DIR}/${target}/${unit}${suffix})
    file(CONFIGURE OUTPUT ${unit} CONTENT "${content}" @ONLY)
    list(APPEND units ${unit})
  endforeach()
  add_library(${target} OBJECT ${units})
  servosense_warnings(${target})
endfunction()
