# Install tree: headers, libraries, CMake package with components, pkg-config files, program.
include(CMakePackageConfigHelpers)

set(servosense_package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/servosense)
set(servosense_components core c servosense c_files)
if(TARGET servosense_hal)
  list(APPEND servosense_components hal)
endif()
install(DIRECTORY include/servosense DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
if(TARGET servosense_cli)
  install(TARGETS servosense_cli RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  if(NOT CMAKE_CROSSCOMPILING)
    install(FILES ${PROJECT_BINARY_DIR}/servosense.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
    install(FILES ${PROJECT_BINARY_DIR}/servosense.bash RENAME servosense
      DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
    install(FILES ${PROJECT_BINARY_DIR}/servosense.zsh RENAME _servosense
      DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/site-functions)
  endif()
endif()
# An export set a component, so that one can be had without what the others need.
foreach(component ${servosense_components})
  if(component STREQUAL "servosense")
    set(target servosense)
  else()
    set(target servosense_${component})
  endif()
  install(TARGETS ${target} EXPORT servosense_${component}
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(EXPORT servosense_${component} NAMESPACE servosense::
    FILE servosense-${component}-targets.cmake DESTINATION ${servosense_package_dir})
endforeach()
configure_package_config_file(cmake/servosense-config.cmake.in
  ${PROJECT_BINARY_DIR}/servosense-config.cmake INSTALL_DESTINATION ${servosense_package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/servosense-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/servosense-config.cmake
  ${PROJECT_BINARY_DIR}/servosense-config-version.cmake DESTINATION ${servosense_package_dir})
# The .pc files find their own prefix, so that the tree may be moved.
file(RELATIVE_PATH servosense_pc_to_prefix
  /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
foreach(name servosense-core servosense-c servosense)
  configure_file(cmake/${name}.pc.in ${PROJECT_BINARY_DIR}/${name}.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/${name}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endforeach()
