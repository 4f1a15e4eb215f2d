# Interface target `tether_options`: what every target of the project compiles with.
add_library(tether_options INTERFACE)
target_include_directories(tether_options INTERFACE ${PROJECT_SOURCE_DIR})
target_link_libraries(tether_options INTERFACE fmt::fmt)
target_compile_options(tether_options INTERFACE -Wall -Wextra -Wpedantic
  $<$<BOOL:${TETHER_WERROR}>:-Werror>
  # GCC collects garbage from 128 MB on, which takes a tenth of its time.
  $<$<CXX_COMPILER_ID:GNU>:--param=ggc-min-heapsize=600000>)
# The Python module is made of the same libraries. Symbols without outside users cost no more than before; the
# vehicle's build has the same objects.
if(NOT TETHER_SANITIZE)
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

# ccache, where it is installed: a second clone, in whatever folder, compiles next to nothing. Paths below
# the checkout are seen relative to the build folder.
find_program(TETHER_CCACHE ccache)
if(TETHER_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_CXX_COMPILER_LAUNCHER env CCACHE_BASEDIR=${PROJECT_SOURCE_DIR} CCACHE_NOHASHDIR=yes
    CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime
    CCACHE_DEPEND=yes CCACHE_PCH_EXTSUM=yes ${TETHER_CCACHE})
endif()

# tether_headers_of(name headers...): the library `name`, which only precompiles these headers.
# tether_use_headers(target name): its sources include them first. A precompiled header is another file each
# time that it is compiled, and Clang's holds the folder's name: ccache knows it by precompile.sh's checksum.
function(tether_headers_of name)
  file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/${name}.cpp CONTENT "// Only for the precompiled headers.\n")
  add_library(${name} OBJECT ${CMAKE_CURRENT_BINARY_DIR}/${name}.cpp)
  target_link_libraries(${name} PUBLIC tether_options)
  target_precompile_headers(${name} PRIVATE ${ARGN})
  set(launcher ${PROJECT_SOURCE_DIR}/cmake/precompile.sh ${CMAKE_CXX_COMPILER_LAUNCHER})
  if(CMAKE_CXX_COMPILER_ID STREQUAL Clang AND NOT CMAKE_DISABLE_PRECOMPILE_HEADERS)
    set(launcher ${PROJECT_SOURCE_DIR}/cmake/precompile.sh)
    set_property(TARGET ${name} PROPERTY TETHER_HEADER ${CMAKE_CURRENT_BINARY_DIR}/CMakeFiles/${name}.dir/cmake_pch.hxx.pch)
  endif()
  if(TETHER_CCACHE)
    set_target_properties(${name} PROPERTIES CXX_COMPILER_LAUNCHER "${launcher}")
  endif()
endfunction()
function(tether_use_headers target name)
  get_target_property(header ${name} TETHER_HEADER)
  if(header)
    get_target_property(sources ${target} SOURCES)
    set_property(SOURCE ${sources} APPEND PROPERTY OBJECT_DEPENDS ${header})
    cmake_path(RELATIVE_PATH header BASE_DIRECTORY ${CMAKE_BINARY_DIR})
    target_compile_options(${target} PRIVATE "SHELL:-include-pch ${header}")
  else()
    target_precompile_headers(${target} REUSE_FROM ${name})
  endif()
endfunction()

# tether_batches(variable name kilobytes sources...): files that include the sources, as many at a time as
# have so many kilobytes; what they share is read once. They name sources relative to the checkout: the
# same files, and the same objects, in each clone. -DTETHER_BATCHES=OFF: each source by itself.
option(TETHER_BATCHES "Compile several sources of a library together" ON)
function(tether_batches variable name kilobytes)
  set(${variable} ${ARGN} PARENT_SCOPE)
  if(NOT TETHER_BATCHES)
    return()
  endif()
  set(files ${ARGN})
  list(FILTER files EXCLUDE REGEX "\\.cpp$")  # generated headers
  set(sources ${ARGN})
  list(FILTER sources INCLUDE REGEX "\\.cpp$")
  set(batch)
  set(bytes 0)
  foreach(source IN LISTS sources ITEMS "")
    if(source)
      cmake_path(ABSOLUTE_PATH source BASE_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR} NORMALIZE)
      file(SIZE ${source} size)
      cmake_path(RELATIVE_PATH source BASE_DIRECTORY ${PROJECT_SOURCE_DIR})
    endif()
    math(EXPR sum "${bytes} + ${size}")
    if(batch AND (NOT source OR sum GREATER ${kilobytes}000))
      list(LENGTH files number)
      set(file ${CMAKE_CURRENT_BINARY_DIR}/${name}_${number}.cpp)
      file(CONFIGURE OUTPUT ${file} CONTENT "${batch}" @ONLY)
      list(APPEND files ${file})
      set(batch)
      set(bytes 0)
    endif()
    string(APPEND batch "#include \"${source}\"\n")
    math(EXPR bytes "${bytes} + ${size}")
  endforeach()
  set(${variable} ${files} PARENT_SCOPE)
endfunction()

# tether_add_library(name [APART] [COLD | COMMAND_LINE] sources...): a library whose sources share these headers, read
# once; or, with COMMAND_LINE, those of common/program.
# Without them (-DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON) everything builds as well.
tether_headers_of(tether_headers
  <fmt/format.h>
  <algorithm> <array> <chrono> <cmath> <deque> <filesystem> <functional> <map> <memory> <optional>
  <random> <set> <span> <stdexcept> <string> <string_view> <utility> <variant> <vector>)
target_compile_options(tether_headers PRIVATE ${TETHER_LIBRARY_OPTIONS})
function(tether_add_library name)
  cmake_parse_arguments(L "APART;COLD;COMMAND_LINE" "" "" ${ARGN})
  set(sources ${L_UNPARSED_ARGUMENTS})
  if(NOT L_APART)
    tether_batches(sources ${name} 80 ${sources})
  endif()
  add_library(${name} ${sources})
  target_link_libraries(${name} PUBLIC tether_options)
  if(L_COMMAND_LINE)
    tether_parses_command_line(${name})
  else()
    target_compile_options(${name} PRIVATE ${TETHER_LIBRARY_OPTIONS} $<$<AND:$<BOOL:${L_COLD}>,$<CONFIG:Release>>:-O1>)
    tether_use_headers(${name} tether_headers)
  endif()
endfunction()
