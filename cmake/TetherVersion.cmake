# Target `tether_version`: version.hpp, whose kVersion is the release and, in a git checkout, the commit.
# Its source is written at each build, but only touched when it changes; who includes the header is
# not compiled again.
set(version_source ${CMAKE_BINARY_DIR}/generated/common/version.cpp)
add_custom_target(tether_version_source
  COMMAND ${CMAKE_COMMAND} -DSOURCE_DIR=${PROJECT_SOURCE_DIR} -DVERSION=${PROJECT_VERSION}
    -DOUTPUT=${version_source} -P ${PROJECT_SOURCE_DIR}/cmake/WriteVersion.cmake
  BYPRODUCTS ${version_source}
  VERBATIM)
file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/generated/common/version.hpp CONTENT
  "#pragma once\n\nnamespace tether {\nextern const char* const kVersion;\n}\n")
add_library(tether_version STATIC ${version_source})
add_dependencies(tether_version tether_version_source)
set_target_properties(tether_version PROPERTIES POSITION_INDEPENDENT_CODE ON)
target_include_directories(tether_version PUBLIC ${CMAKE_BINARY_DIR}/generated)
