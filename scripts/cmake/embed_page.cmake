# SPDX-License-Identifier: Apache-2.0
# Writes OUTPUT, C++ whose FUNCTION returns the text of PAGE, out of TEMPLATE.
cmake_minimum_required(VERSION 3.25)
file(READ "${PAGE}" GS_PAGE)
configure_file("${TEMPLATE}" "${OUTPUT}" @ONLY)
file(TOUCH "${OUTPUT}")
