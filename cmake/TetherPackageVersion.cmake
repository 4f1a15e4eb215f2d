# Read by cpack before it installs anything.

# Ninja's cpack builds nothing, and what is not built ends it with the name of one file.
set(missing)
foreach(component IN LISTS CPACK_COMPONENTS_ALL)
  string(TOUPPER ${component} component)
  foreach(file IN LISTS CPACK_TETHER_${component}_FILES)
    if(NOT EXISTS ${CPACK_TETHER_BUILD_DIR}/${file})
      cmake_path(GET file FILENAME file)
      list(APPEND missing ${file})
    endif()
  endforeach()
endforeach()
if(missing)
  list(JOIN missing ", " missing)
  message("cpack: not built: ${missing}. Run: cmake --build ${CPACK_TETHER_BUILD_DIR} --target packaged")
  message(FATAL_ERROR)
endif()

# Time stamps in a package are its commit's, so that the same commit gives the same bytes.
if(NOT DEFINED ENV{SOURCE_DATE_EPOCH})
  execute_process(COMMAND git -C ${CPACK_TETHER_SOURCE_DIR} log -1 --format=%ct
    OUTPUT_VARIABLE time OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  if(time)
    set(ENV{SOURCE_DATE_EPOCH} ${time})
  endif()
endif()

# A package of a git checkout has its commit in its version, as its programs have, so that apt
# takes two builds of one release for two: 0.1.0+20261126091500.1f219cccf651, in the order of their
# commits. A version that cpack was given (-D CPACK_PACKAGE_VERSION=…) stays.
if(NOT CPACK_PACKAGE_VERSION STREQUAL CPACK_TETHER_RELEASE)
  return()
endif()
execute_process(COMMAND ${CMAKE_COMMAND} -E env TZ=UTC git -C ${CPACK_TETHER_SOURCE_DIR} log -1 --format=%cd.%h
    --abbrev=12 --date=format-local:%Y%m%d%H%M%S
  OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
if(commit)
  set(CPACK_PACKAGE_VERSION ${CPACK_TETHER_RELEASE}+${commit})
  foreach(component LAB PYTHON ENV)
    foreach(relation DEPENDS RECOMMENDS)
      string(REPLACE "(= ${CPACK_TETHER_RELEASE})" "(= ${CPACK_PACKAGE_VERSION})"
        CPACK_DEBIAN_${component}_PACKAGE_${relation} "${CPACK_DEBIAN_${component}_PACKAGE_${relation}}")
    endforeach()
  endforeach()
endif()
