# Places of the files of `cmake --install`, and the Debian packages that `cpack -G DEB` makes of them:
#
#   tether-vehicle  what a vehicle's computer runs, with scenarios and drivetrains to begin from
#   tether          all else: simulator, relay, controller, sweeps, figures, the page
#   python3-tether  controllers in Python, and readers of runs, sweeps and logs
#   python3-tether-env  closed loops as environments for learning programs; compiled
#   tether-dev      messages and a controller's client, for C++ (a CMake package); for lcm-gen
#   tether-doc      docs/, examples and the change log
#
# Programs find what they read in ../share/tether from where they lie (common/base/share.hpp).
include(GNUInstallDirs)

set(TETHER_VEHICLE_PROGRAMS tether-vehicle tether-link tether-can-bridge tether-can-drive tether-localiser tether-autonomy)
set(TETHER_LAB_PROGRAMS tether tether-sim tether-netem tether-controller tether-can tether-tun tether-floor)
if(TARGET tether-ros2)
  list(APPEND TETHER_LAB_PROGRAMS tether-ros2)
endif()
set(shared ${CMAKE_INSTALL_DATADIR}/tether)

install(TARGETS ${TETHER_VEHICLE_PROGRAMS} COMPONENT vehicle)
install(DIRECTORY scenarios drivetrains DESTINATION ${shared} COMPONENT vehicle
  FILES_MATCHING REGEX "\\.(toml|csv|yaml|pgm)$")

# Units, for the packages: they start /usr/bin/….
set(units lib/systemd/system)
foreach(unit host link can-bridge can-links localiser autonomy logger metrics)
  install(FILES systemd/tether-${unit}.service DESTINATION ${units} COMPONENT vehicle)
endforeach()
install(FILES systemd/hardening.conf DESTINATION ${units}/tether-.service.d COMPONENT vehicle)
install(FILES systemd/sysusers.conf DESTINATION lib/sysusers.d RENAME tether.conf COMPONENT vehicle)
install(FILES systemd/tether.env systemd/tether.nft systemd/can0.network systemd/can0.link systemd/bind-can0.conf DESTINATION ${shared}/systemd
  COMPONENT vehicle)

install(TARGETS tether_lcmtypes tether_client EXPORT tether-targets COMPONENT dev)
install(DIRECTORY ${CMAKE_BINARY_DIR}/generated/lcmtypes/tether
  ${CMAKE_BINARY_DIR}/generated/lcmtypes/lcm-gen
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/tether COMPONENT dev FILES_MATCHING PATTERN "*.hpp")
install(FILES lcmtypes/law_client.hpp DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/tether/tether
  COMPONENT dev)
install(DIRECTORY lcmtypes/ DESTINATION ${shared}/lcmtypes COMPONENT dev
  FILES_MATCHING PATTERN "*.lcm")
set(package ${CMAKE_INSTALL_LIBDIR}/cmake/tether)
install(EXPORT tether-targets NAMESPACE tether:: DESTINATION ${package} COMPONENT dev)
include(CMakePackageConfigHelpers)
write_basic_package_version_file(${CMAKE_BINARY_DIR}/tether-config-version.cmake
  COMPATIBILITY SameMinorVersion ARCH_INDEPENDENT)
install(FILES cmake/tether-config.cmake cmake/TetherLcm.cmake
  ${CMAKE_BINARY_DIR}/tether-config-version.cmake DESTINATION ${package} COMPONENT dev)

# For builds without CMake: pkg-config --cflags --libs tether. LCM's own .pc file wants GLib's.
file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/tether.pc CONTENT "prefix=\${pcfiledir}/../..
aliasing=-fno-strict-aliasing

Name: tether
Description: ${PROJECT_DESCRIPTION}: messages, and a controller's client (C++17)
Version: ${PROJECT_VERSION}
Cflags: -I\${prefix}/include/tether \${aliasing}
Libs: -llcm
" @ONLY)
install(FILES ${CMAKE_BINARY_DIR}/tether.pc DESTINATION ${CMAKE_INSTALL_DATADIR}/pkgconfig COMPONENT dev)

install(DIRECTORY docs/ DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT doc)
install(FILES README.md CHANGELOG.md DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT doc)
install(FILES examples/controller.cpp examples/controller.py
  DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples COMPONENT doc)
install(PROGRAMS examples/floor_in_a_box.sh examples/learn_pid.py DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples COMPONENT doc)

# tether_install_manuals(component programs...): their manual pages, and what completes their command
# lines, as they print both.
function(tether_install_manuals component)
  foreach(program IN LISTS ARGN)
    set(page ${CMAKE_BINARY_DIR}/man/${program})
    install(CODE "
      file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/man)
      execute_process(COMMAND $<TARGET_FILE:${program}> --man OUTPUT_FILE ${page}.1
        COMMAND_ERROR_IS_FATAL ANY)
      execute_process(COMMAND gzip -9nf ${page}.1 COMMAND_ERROR_IS_FATAL ANY)
      execute_process(COMMAND $<TARGET_FILE:${program}> --completion bash OUTPUT_FILE ${page}.bash
        COMMAND_ERROR_IS_FATAL ANY)
      execute_process(COMMAND $<TARGET_FILE:${program}> --completion zsh OUTPUT_FILE ${page}.zsh
        COMMAND_ERROR_IS_FATAL ANY)"
      COMPONENT ${component})
    install(FILES ${page}.1.gz DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT ${component})
    install(FILES ${page}.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
      RENAME ${program} COMPONENT ${component})
    install(FILES ${page}.zsh DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions
      RENAME _${program} COMPONENT ${component})
  endforeach()
endfunction()
tether_install_manuals(vehicle ${TETHER_VEHICLE_PROGRAMS})

set(components vehicle dev doc)
if(NOT TETHER_VEHICLE_ONLY)
  list(APPEND components lab)
  install(TARGETS ${TETHER_LAB_PROGRAMS} COMPONENT lab)
  install(FILES systemd/tether-controller.service systemd/tether-controller@.service systemd/tether-view.service DESTINATION ${units}
    COMPONENT lab)
  install(DIRECTORY experiments DESTINATION ${shared} COMPONENT lab FILES_MATCHING PATTERN "*.toml")
  install(DIRECTORY ${CMAKE_BINARY_DIR}/share/tether/report ${CMAKE_BINARY_DIR}/share/tether/swept
    ${CMAKE_BINARY_DIR}/share/tether/view ${CMAKE_BINARY_DIR}/share/tether/java
    DESTINATION ${shared} COMPONENT lab)
  tether_install_manuals(lab ${TETHER_LAB_PROGRAMS})
  # Where Debian's Python looks; the messages' descriptions come along.
  list(APPEND components python)
  set(python_packages lib/python3/dist-packages)
  install(DIRECTORY python/tether DESTINATION ${python_packages} COMPONENT python
    FILES_MATCHING PATTERN "*.py" PATTERN __pycache__ EXCLUDE)
  install(DIRECTORY lcmtypes/ DESTINATION ${python_packages}/tether/lcmtypes COMPONENT python
    FILES_MATCHING PATTERN "*.lcm")
  if(TETHER_PYTHON)
    list(APPEND components env)
    install(TARGETS tether_env_core DESTINATION ${python_packages}/tether_env COMPONENT env)
    install(DIRECTORY python/env/tether_env DESTINATION ${python_packages} COMPONENT env
      FILES_MATCHING PATTERN "*.py" PATTERN __pycache__ EXCLUDE)
  endif()
endif()

# In a build tree, the same files are where they are kept.
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/share/tether)
foreach(folder scenarios experiments drivetrains)
  file(CREATE_LINK ${PROJECT_SOURCE_DIR}/${folder} ${CMAKE_BINARY_DIR}/share/tether/${folder}
    SYMBOLIC)
endforeach()

# All that is installed, without tests and benchmarks.
add_custom_target(packaged)
add_dependencies(packaged ${TETHER_VEHICLE_PROGRAMS} tether_lcmtypes_generated)
if(NOT TETHER_VEHICLE_ONLY)
  add_dependencies(packaged ${TETHER_LAB_PROGRAMS})
endif()
if(TETHER_PYTHON)
  add_dependencies(packaged tether_env)
endif()

include(TetherDebian)
