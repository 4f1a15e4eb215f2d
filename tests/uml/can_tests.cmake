# Tests that need a kernel with CAN or tc's netem (labels vcan and kernel).

# Where they run is a label too: native or uml; none, if they cannot run here and will fail.
function(tether_find_kernel variable)
  execute_process(COMMAND ${TETHER_WITH_CAN} ${ARGN} --where
    OUTPUT_VARIABLE kernel ERROR_QUIET)
  string(REGEX MATCH "native|User-Mode" kernel "${kernel}")
  string(REPLACE "User-Mode" "uml" kernel "${kernel}")
  if(NOT kernel)
    set(kernel none)
  endif()
  set(${variable} ${kernel} PARENT_SCOPE)
endfunction()
tether_find_kernel(can_kernel)
tether_find_kernel(netem_kernel --netem)

# A guest has a clock of its own (guest_clock.cpp): it computes, and nothing hurries it.
function(tether_on_the_kernels_clock test)
  if(NOT uml IN_LIST ARGN)
    tether_on_the_wall_clock(${test} PLACES 2)
  endif()
endfunction()

# tether_add_can_test(NAME name {SCRIPT file | PROGRAM target} TIMEOUT seconds [NETEM | GUEST]): runs
# `file BIN_DIR` or the program where CAN interfaces can be made, or with NETEM where tc has netem, or with
# GUEST always in a guest (with_can.sh). What it writes to $TETHER_CAN_RESULTS stays in the build folder's can_results/.
function(tether_add_can_test)
  cmake_parse_arguments(T "NETEM;GUEST" "NAME;SCRIPT;PROGRAM;TIMEOUT" "" ${ARGN})
  if(T_NETEM)
    set(network --netem)
    set(labels kernel ${netem_kernel})
  elseif(T_GUEST)
    set(network --guest)
    set(labels vcan uml)
  else()
    set(network)
    set(labels vcan ${can_kernel})
  endif()
  if(T_PROGRAM)
    set(command $<TARGET_FILE:${T_PROGRAM}>)
  else()
    set(command ${CMAKE_CURRENT_SOURCE_DIR}/${T_SCRIPT} ${CMAKE_RUNTIME_OUTPUT_DIRECTORY})
  endif()
  if(TETHER_SANITIZE)  # AddressSanitizer's shadow is larger than User-Mode Linux's address space
    if(T_PROGRAM)
      set_target_properties(${T_PROGRAM} PROPERTIES EXCLUDE_FROM_ALL TRUE)
    endif()
    return()
  endif()
  set(results ${CMAKE_BINARY_DIR}/can_results/${T_NAME})
  file(MAKE_DIRECTORY ${results})
  add_test(NAME ${T_NAME} COMMAND ${TETHER_WITH_CAN} ${network} ${command})
  math(EXPR own "6 * ${T_TIMEOUT}")  # a guest on a busy machine; some machines are three times as slow at system calls as at computing
  math(EXPR timeout "${own} + 20")  # with_can.sh's own comes first, and says more
  set_tests_properties(${T_NAME} PROPERTIES LABELS "${labels}" TIMEOUT ${timeout}
    COST ${T_TIMEOUT}
    ENVIRONMENT "TETHER_CAN_TIMEOUT=${own};TETHER_CAN_RESULTS=${results}")
  tether_on_the_kernels_clock(${T_NAME} ${labels})
endfunction()
