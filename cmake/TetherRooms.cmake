# A room is a folder with a library of its own: can_bridge/safety is the target
# tether_can_bridge_safety.
#
# tether_add_room([SOURCES files...] [USES folders...] [LIBS targets...] [PRIVATE_LIBS targets...] [APART]
# [COLD | COMMAND_LINE]):
# the library of this folder. USES: all other rooms that its files include, and nothing else
# (tests/lint/rooms.py checks it, and that no arrow runs back up). APART: its sources have things of one
# name, so that they cannot be compiled together. COLD: runs once or seldom, so that a third less to compile counts
# more than its speed. COMMAND_LINE: uses CLI11, whose header makes a dozen objects wherever it is included.
function(tether_add_room)
  cmake_parse_arguments(R "APART;COLD;COMMAND_LINE" "" "SOURCES;USES;LIBS;PRIVATE_LIBS" ${ARGN})
  tether_rooms(name ${CMAKE_CURRENT_SOURCE_DIR})
  tether_rooms(uses ${R_USES})
  if(R_SOURCES)
    set(options)
    foreach(option APART COLD COMMAND_LINE)
      if(R_${option})
        list(APPEND options ${option})
      endif()
    endforeach()
    tether_add_library(${name} ${options} ${R_SOURCES})
    target_link_libraries(${name} PUBLIC ${uses} ${R_LIBS} PRIVATE ${R_PRIVATE_LIBS})
  else()
    add_library(${name} INTERFACE)
    target_link_libraries(${name} INTERFACE tether_options ${uses} ${R_LIBS} ${R_PRIVATE_LIBS})
  endif()
endfunction()

# tether_rooms(variable folders...): their targets.
function(tether_rooms variable)
  set(names)
  foreach(folder IN LISTS ARGN)
    cmake_path(IS_PREFIX PROJECT_SOURCE_DIR ${folder} is_absolute)
    if(is_absolute)
      cmake_path(RELATIVE_PATH folder BASE_DIRECTORY ${PROJECT_SOURCE_DIR})
    endif()
    string(REPLACE / _ name tether_${folder})
    list(APPEND names ${name})
  endforeach()
  set(${variable} ${names} PARENT_SCOPE)
endfunction()

# tether_add_program(name source [COMMAND_LINE]): a node's program, linked with this folder's room and with what
# sections scenarios have. COMMAND_LINE: uses CLI11 itself.
function(tether_add_program name source)
  cmake_parse_arguments(P "COMMAND_LINE" "" "" ${ARGN})
  tether_rooms(room ${CMAKE_CURRENT_SOURCE_DIR})
  add_executable(${name} ${source})
  target_link_libraries(${name} PRIVATE ${room} tether_common_program tether_scenarios)
  if(P_COMMAND_LINE)
    tether_parses_command_line(${name})
  else()
    target_compile_options(${name} PRIVATE ${TETHER_LIBRARY_OPTIONS})
    tether_use_headers(${name} tether_headers)
  endif()
endfunction()
