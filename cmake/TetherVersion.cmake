# Target `tether_version`: version.hpp with the release and, in a git checkout, the commit; written
# anew at each build, but only touched when it changes.
add_custom_target(tether_version_header
  COMMAND ${CMAKE_COMMAND} -DSOURCE_DIR=${PROJECT_SOURCE_DIR} -DVERSION=${PROJECT_VERSION}
    -DOUTPUT=${CMAKE_BINARY_DIR}/generated/common/version.hpp
    -P ${PROJECT_SOURCE_DIR}/cmake/WriteVersion.cmake
  BYPRODUCTS ${CMAKE_BINARY_DIR}/generated/common/version.hpp
  VERBATIM)
add_library(tether_version INTERFACE)
add_dependencies(tether_version tether_version_header)
target_include_directories(tether_version INTERFACE ${CMAKE_BINARY_DIR}/generated)
