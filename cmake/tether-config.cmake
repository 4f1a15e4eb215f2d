# find_package(tether): target tether::messages, the messages of docs/architecture.md as C++
# headers (<tether/pose_t.hpp> …), with LCM.
list(APPEND CMAKE_MODULE_PATH ${CMAKE_CURRENT_LIST_DIR})
include(TetherLcm)
include(${CMAKE_CURRENT_LIST_DIR}/tether-targets.cmake)
