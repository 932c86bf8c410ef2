# Install tree: headers, libraries, CMake package, pkg-config file, program.
include(CMakePackageConfigHelpers)

set(servosense_package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/servosense)
set(servosense_installed servosense_core servosense servosense_c servosense_c_files)
if(TARGET servosense_hal)
  list(APPEND servosense_installed servosense_hal)
endif()
install(DIRECTORY include/servosense DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(TARGETS ${servosense_installed} EXPORT servosense_exports
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
if(TARGET servosense_cli)
  install(TARGETS servosense_cli RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  if(NOT CMAKE_CROSSCOMPILING)
    install(FILES ${PROJECT_BINARY_DIR}/servosense.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
    install(FILES ${PROJECT_BINARY_DIR}/servosense.bash RENAME servosense
      DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
  endif()
endif()
install(EXPORT servosense_exports NAMESPACE servosense:: FILE servosense-targets.cmake
  DESTINATION ${servosense_package_dir})
configure_package_config_file(cmake/servosense-config.cmake.in
  ${PROJECT_BINARY_DIR}/servosense-config.cmake INSTALL_DESTINATION ${servosense_package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/servosense-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/servosense-config.cmake
  ${PROJECT_BINARY_DIR}/servosense-config-version.cmake DESTINATION ${servosense_package_dir})
# The .pc file finds its own prefix, so that the tree may be moved.
file(RELATIVE_PATH servosense_pc_to_prefix
  /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
configure_file(cmake/servosense.pc.in ${PROJECT_BINARY_DIR}/servosense.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/servosense.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
