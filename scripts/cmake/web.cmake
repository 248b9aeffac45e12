# SPDX-License-Identifier: Apache-2.0
# Finds what bundles the pages of apps/web: node, and the packages of package-lock.json, which npm
# installs into the build folder once. If npm or its registry cannot be reached, the program is
# built without pages, or with those that scripts/pack_headers.sh has put beside the headers.
#
# Sets GS_HAVE_WEB (the program has pages), GS_HAVE_NPM (the pages are bundled here), GS_NODE,
# GS_WEB_DIR.
set(GS_HAVE_WEB FALSE)
set(GS_HAVE_NPM FALSE)
set(GS_WEB_DIR ${PROJECT_BINARY_DIR}/web)
set(gs_web_missing "")

# gs_install_web_packages(result): runs npm ci if package-lock.json has changed since the last time.
function(gs_install_web_packages result)
  set(source ${PROJECT_SOURCE_DIR}/apps/web)
  set_property(DIRECTORY ${PROJECT_SOURCE_DIR} APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${source}/package-lock.json)
  set(stamp ${GS_WEB_DIR}/packages.stamp)
  set(which --omit=dev)
  if(GS_BUILD_TESTS)
    set(which --include=dev)  # for the tests in a browser
  endif()
  file(SHA256 ${source}/package-lock.json wanted)
  string(APPEND wanted " ${which}")
  set(installed "")
  if(EXISTS ${stamp})
    file(READ ${stamp} installed)
  endif()
  if(NOT installed STREQUAL wanted)
    file(REMOVE ${stamp})  # npm ci begins by deleting what was there
    file(COPY ${source}/package.json ${source}/package-lock.json DESTINATION ${GS_WEB_DIR})
    execute_process(
      COMMAND ${GS_NPM} ci ${which} --ignore-scripts --no-audit --no-fund --prefer-offline --fetch-retries=1 --fetch-timeout=30000
      WORKING_DIRECTORY ${GS_WEB_DIR} RESULT_VARIABLE code OUTPUT_VARIABLE log ERROR_VARIABLE log TIMEOUT 300)
    file(WRITE ${GS_WEB_DIR}/npm.log "${log}")
    if(NOT code STREQUAL "0")
      set(${result} FALSE PARENT_SCOPE)
      return()
    endif()
    file(WRITE ${stamp} "${wanted}")
  endif()
  set(${result} TRUE PARENT_SCOPE)
endfunction()

if(GS_WITH_WEB)
  find_program(GS_NPM npm)
  find_program(GS_NODE NAMES node nodejs)
  if(GS_NPM AND GS_NODE)
    gs_install_web_packages(GS_HAVE_NPM)
    if(NOT GS_HAVE_NPM)
      string(APPEND gs_web_missing " (npm ci failed: ${GS_WEB_DIR}/npm.log)")
    endif()
  endif()
endif()
set(GS_HAVE_WEB ${GS_HAVE_NPM})
if(NOT GS_HAVE_WEB AND GS_DEPS_INCLUDE)
  cmake_path(GET GS_DEPS_INCLUDE PARENT_PATH packed)
  foreach(page report.html studio.html view.html)
    if(EXISTS ${packed}/web/${page})
      file(COPY ${packed}/web/${page} DESTINATION ${GS_WEB_DIR})
      set(GS_HAVE_WEB TRUE)
    endif()
  endforeach()
endif()
gs_report("reports" GS_WITH_WEB "${GS_HAVE_WEB}" "reports are written by `gemsplat report` of another build, on the same folders${gs_web_missing}" "writes report.html of runs and experiments" npm)
gs_report("viewer" GS_WITH_WEB "${GS_HAVE_WEB}" "there is no viewer${gs_web_missing}" "serves models and runs to a browser (`gemsplat view`, `train --viewer`)" npm)
