# SPDX-License-Identifier: Apache-2.0
# Writes OUTPUT from TEMPLATE: C++ with a function FUNCTION that returns the text of PAGE.
cmake_minimum_required(VERSION 3.25)
file(READ "${PAGE}" GS_PAGE)
configure_file("${TEMPLATE}" "${OUTPUT}" @ONLY)
file(TOUCH "${OUTPUT}")
