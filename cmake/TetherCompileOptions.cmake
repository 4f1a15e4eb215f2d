# Interface target `tether_options`: what every target of the project compiles with.
add_library(tether_options INTERFACE)
target_include_directories(tether_options INTERFACE ${PROJECT_SOURCE_DIR})
target_link_libraries(tether_options INTERFACE fmt::fmt)
target_compile_options(tether_options INTERFACE -Wall -Wextra -Wpedantic
  $<$<BOOL:${TETHER_WERROR}>:-Werror>)
# The Python module is made of the same libraries. What nobody outside sees costs no more than before.
if(TETHER_PYTHON)
  target_compile_options(tether_options INTERFACE -fPIC -fvisibility=hidden)
endif()

if(TETHER_SANITIZE)
  set(sanitizers -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)
  # GCC 12 warns falsely within <regex> and <optional> when it instruments them.
  target_compile_options(tether_options INTERFACE ${sanitizers}
    $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
  target_link_options(tether_options INTERFACE ${sanitizers})
  # Libraries, and not the tests, tell fuzzers where they have been.
  if(CMAKE_CXX_COMPILER_ID STREQUAL Clang)
    set(TETHER_LIBRARY_OPTIONS -fsanitize=fuzzer-no-link)
  endif()
endif()

# tether_add_library(name sources...): a library whose sources share these headers, read once.
# Without them (-DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON) everything builds as well.
add_library(tether_headers OBJECT ${PROJECT_SOURCE_DIR}/common/base/headers.cpp)
target_link_libraries(tether_headers PRIVATE tether_options)
target_compile_options(tether_headers PRIVATE ${TETHER_LIBRARY_OPTIONS})
target_precompile_headers(tether_headers PRIVATE
  <fmt/format.h>
  <algorithm> <array> <chrono> <cmath> <deque> <filesystem> <functional> <map> <memory> <optional>
  <random> <set> <span> <stdexcept> <string> <string_view> <utility> <variant> <vector>)
function(tether_add_library name)
  add_library(${name} ${ARGN})
  target_link_libraries(${name} PUBLIC tether_options)
  target_compile_options(${name} PRIVATE ${TETHER_LIBRARY_OPTIONS})
  target_precompile_headers(${name} REUSE_FROM tether_headers)
endfunction()
