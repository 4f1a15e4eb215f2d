# Debian packages, one for each component of TetherInstall.cmake:
#   cpack -G DEB --config build/release/CPackConfig.cmake -B build/packages
# The builder of packages for others is responsible for them, and is named in the packages.
set(TETHER_MAINTAINER "The Tether authors <maintainers@tether.invalid>" CACHE STRING "Maintainer of the Debian packages: Name <mail address>")
if(NOT TETHER_MAINTAINER MATCHES "^[^<>,\n]*[^<>,\n ] <[^<>@, ]+@[^<>@, ]+>$")
  message(FATAL_ERROR "TETHER_MAINTAINER = \"${TETHER_MAINTAINER}\" is not allowed: must be \"Name <mail address>\"")
endif()
set(CPACK_PACKAGE_CONTACT "${TETHER_MAINTAINER}")
set(CPACK_PACKAGE_HOMEPAGE_URL "")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cmake/TetherPackageFolders.cmake)
set(CPACK_POST_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cmake/TetherPackageModes.cmake)
set(CPACK_TETHER_PYTHON ${Python3_EXECUTABLE})
set(CPACK_PROJECT_CONFIG_FILE ${PROJECT_SOURCE_DIR}/cmake/TetherPackageVersion.cmake)
set(CPACK_TETHER_SOURCE_DIR ${PROJECT_SOURCE_DIR})
set(CPACK_TETHER_RELEASE ${PROJECT_VERSION})
set(CPACK_COMPONENTS_ALL ${components})
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "testbed for vehicles steered over a bad network")
# Debian wants a change log of its own form, and compressed.
set(make_changelog "
    string(TIMESTAMP now \"%a, %d %b %Y %H:%M:%S +0000\" UTC)  # $SOURCE_DATE_EPOCH, if it is set
    file(WRITE ${CMAKE_BINARY_DIR}/changelog \"tether (${PROJECT_VERSION}) unstable; urgency=medium

  * See CHANGELOG.md of the package tether-doc.

 -- ${CPACK_PACKAGE_CONTACT}  \${now}
\")
    execute_process(COMMAND gzip -9nc ${CMAKE_BINARY_DIR}/changelog
      OUTPUT_FILE ${CMAKE_BINARY_DIR}/changelog.gz COMMAND_ERROR_IS_FATAL ANY)")

# tether_debian_package(component name "description" [ARCH all] [DEPENDS ...] [RECOMMENDS ...] [SUGGESTS ...])
function(tether_debian_package component name description)
  cmake_parse_arguments(D "" "ARCH;DEPENDS;RECOMMENDS;SUGGESTS" "" ${ARGN})
  string(TOUPPER ${component} up)
  set(CPACK_DEBIAN_${up}_PACKAGE_NAME ${name} PARENT_SCOPE)
  set(CPACK_COMPONENT_${up}_DESCRIPTION "${description}" PARENT_SCOPE)
  set(CPACK_DEBIAN_${up}_PACKAGE_DEPENDS "${D_DEPENDS}" PARENT_SCOPE)
  set(CPACK_DEBIAN_${up}_PACKAGE_RECOMMENDS "${D_RECOMMENDS}" PARENT_SCOPE)
  set(CPACK_DEBIAN_${up}_PACKAGE_SUGGESTS "${D_SUGGESTS}" PARENT_SCOPE)
  if(D_ARCH)
    set(CPACK_DEBIAN_${up}_PACKAGE_ARCHITECTURE ${D_ARCH} PARENT_SCOPE)
  else()
    set(CPACK_DEBIAN_${up}_PACKAGE_SHLIBDEPS ON PARENT_SCOPE)
  endif()
  # Debian wants both in each package.
  set(folder ${CMAKE_INSTALL_DATADIR}/doc/${name})
  install(FILES LICENSE DESTINATION ${folder} RENAME copyright COMPONENT ${component})
  install(CODE "${make_changelog}" COMPONENT ${component})
  install(FILES ${CMAKE_BINARY_DIR}/changelog.gz DESTINATION ${folder} COMPONENT ${component})
endfunction()

set(scripts ${PROJECT_SOURCE_DIR}/systemd)
set(CPACK_DEBIAN_VEHICLE_PACKAGE_CONTROL_EXTRA ${scripts}/postinst ${scripts}/prerm)
set(CPACK_DEBIAN_LAB_PACKAGE_CONTROL_EXTRA ${scripts}/prerm)
tether_debian_package(vehicle tether-vehicle
  "For a vehicle's computer: the CAN bridge to the motors' drives, localiser and
 on-board driver, with drivetrain files and scenarios to begin from."
  RECOMMENDS "can-utils, iproute2, nftables")
tether_debian_package(dev tether-dev
  "For other programs: the messages as C++ headers with a CMake package, and as
 LCM types for other languages."
  ARCH all DEPENDS "liblcm-dev, liblcm-bin")
tether_debian_package(doc tether-doc
  "The documentation: how to run, measure and extend it, and example controllers."
  ARCH all)
if(NOT TETHER_VEHICLE_ONLY)
  tether_debian_package(lab tether
    "Simulates a remotely controlled vehicle and the network between: how much delay
 and loss does it survive? The same controller then runs on a factory floor."
    DEPENDS "tether-vehicle (= ${PROJECT_VERSION}), gnuplot-nox"
    RECOMMENDS liblcm-bin
    SUGGESTS "liblcm-java, libjchart2d-java, default-jre")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
  tether_debian_package(python python3-tether
    "Controllers in Python for simulated and live runs, and readers of runs, sweeps and
 LCM logs: of the standard library alone."
    ARCH all DEPENDS "python3 (>= 3.11)" RECOMMENDS "tether (= ${PROJECT_VERSION}), python3-numpy")
  if(TETHER_PYTHON)
    set(CPACK_DEBIAN_ENV_PACKAGE_SECTION python)
    set(this ${Python3_VERSION_MAJOR}.${Python3_VERSION_MINOR})
    math(EXPR after "${Python3_VERSION_MINOR} + 1")
    tether_debian_package(env python3-tether-env
      "The closed loop of vehicle, network and controller as an environment for learning
 programs, by Gymnasium's contract, one or many at once."
      DEPENDS "tether-vehicle (= ${PROJECT_VERSION}), python3-numpy, python3 (>= ${this}), python3 (<< ${Python3_VERSION_MAJOR}.${after})")
  endif()
endif()
# Checks of cpack before it begins (TetherPackageVersion.cmake): files of the build folder, by component.
set(CPACK_TETHER_BUILD_DIR ${CMAKE_BINARY_DIR})
list(TRANSFORM TETHER_VEHICLE_PROGRAMS PREPEND bin/ OUTPUT_VARIABLE CPACK_TETHER_VEHICLE_FILES)
list(TRANSFORM TETHER_LAB_PROGRAMS PREPEND bin/ OUTPUT_VARIABLE CPACK_TETHER_LAB_FILES)
set(CPACK_TETHER_DEV_FILES generated/lcmtypes/tether/pose_t.hpp)
set(CPACK_TETHER_ENV_FILES python/tether_env/_core.${Python3_SOABI}.so)
include(CPack)
