# Interface target `tether_options`: what every target of the project compiles with.
add_library(tether_options INTERFACE)
target_include_directories(tether_options INTERFACE ${PROJECT_SOURCE_DIR})
target_compile_options(tether_options INTERFACE -Wall -Wextra -Wpedantic
  $<$<BOOL:${TETHER_WERROR}>:-Werror>)

if(TETHER_SANITIZE)
  set(sanitizers -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)
  # GCC 12 warns falsely within <regex> and <optional> when it instruments them.
  target_compile_options(tether_options INTERFACE ${sanitizers} -Wno-maybe-uninitialized)
  target_link_options(tether_options INTERFACE ${sanitizers})
endif()
