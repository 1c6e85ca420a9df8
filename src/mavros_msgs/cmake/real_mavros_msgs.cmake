# SPDX-License-Identifier: Apache-2.0
# Where the real mavros_msgs is, if anywhere. CMakeLists.txt includes this file; tools/setup.sh runs it
# ('cmake -P'), which prints the place, or nothing.

get_filename_component(_mavros_msgs_sources "${CMAKE_CURRENT_LIST_DIR}/../.." ABSOLUTE)

# Sets OUT to the folder of the manifest of a mavros_msgs that is not a stand-in of fcsv, else to "". Looked at are all
# spaces that the environment names, installed or not yet (then their configuration names the sources), /usr/local and
# /usr, and the sources in this workspace. The stand-in's manifest says that it is one, here and in any other clone.
function(find_real_mavros_msgs OUT)
  file(GLOB manifests "${_mavros_msgs_sources}/*/package.xml" "${_mavros_msgs_sources}/*/*/package.xml")
  string(REPLACE ":" ";" prefixes "$ENV{CMAKE_PREFIX_PATH}")
  foreach(prefix ${prefixes} ${CMAKE_PREFIX_PATH} /usr/local /usr)
    set(configuration "${prefix}/share/mavros_msgs/cmake/mavros_msgsConfig.cmake")
    if(EXISTS "${configuration}")
      file(STRINGS "${configuration}" line REGEX "^set\\(mavros_msgs_SOURCE_PREFIX /")
      string(REGEX REPLACE "^set\\(mavros_msgs_SOURCE_PREFIX (.*)\\)$" "\\1" sources "${line}")
      list(APPEND manifests "${prefix}/share/mavros_msgs/package.xml" "${sources}/package.xml")
    endif()
  endforeach()
  set(${OUT} "" PARENT_SCOPE)
  foreach(manifest ${manifests})
    if(EXISTS "${manifest}")
      file(READ "${manifest}" text)
      if(text MATCHES "<name>mavros_msgs</name>" AND NOT text MATCHES "<stand_in of=\"mavros_msgs\"")
        get_filename_component(folder "${manifest}" DIRECTORY)
        set(${OUT} "${folder}" PARENT_SCOPE)
        return()
      endif()
    endif()
  endforeach()
endfunction()

if(CMAKE_SCRIPT_MODE_FILE)
  find_real_mavros_msgs(real)
  if(real)
    execute_process(COMMAND ${CMAKE_COMMAND} -E echo "${real}")
  endif()
endif()
