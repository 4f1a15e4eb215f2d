# find_package(tether): targets tether::messages, the messages of docs/explanation/architecture.md as C++ headers
# (<tether/pose_t.hpp> …), with LCM; and tether::client, with which a controller is its law
# (<tether/law_client.hpp>).
list(APPEND CMAKE_MODULE_PATH ${CMAKE_CURRENT_LIST_DIR})
include(TetherLcm)
include(${CMAKE_CURRENT_LIST_DIR}/tether-targets.cmake)
