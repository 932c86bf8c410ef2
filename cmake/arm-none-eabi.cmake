# Cortex-M4F or M7 (SERVOSENSE_CORE = m4 | m7) with the GNU Arm toolchain.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)

set(SERVOSENSE_CORE m4 CACHE STRING "Cortex-M core: m4 (M4F) or m7 (M7)")
set_property(CACHE SERVOSENSE_CORE PROPERTY STRINGS m4 m7)
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES SERVOSENSE_CORE)
set(servosense_fpu_m4 fpv4-sp-d16)
set(servosense_fpu_m7 fpv5-d16)
if(NOT DEFINED servosense_fpu_${SERVOSENSE_CORE})
  message(FATAL_ERROR "SERVOSENSE_CORE is '${SERVOSENSE_CORE}', must be m4 or m7")
endif()

set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_CXX_COMPILER arm-none-eabi-g++)
set(servosense_core_flags "-mcpu=cortex-${SERVOSENSE_CORE} -mthumb -mfloat-abi=hard \
-mfpu=${servosense_fpu_${SERVOSENSE_CORE}}")
set(CMAKE_C_FLAGS_INIT "${servosense_core_flags}")
set(CMAKE_CXX_FLAGS_INIT
  "${servosense_core_flags} -fno-exceptions -fno-rtti -fno-threadsafe-statics -fno-use-cxa-atexit")

# No operating system to link against while CMake tries the compiler.
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
