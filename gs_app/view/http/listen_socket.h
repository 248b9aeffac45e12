// SPDX-License-Identifier: Apache-2.0
// The socket at which a server waits for connections.
#pragma once

#include <string>

#include "gs_app/view/http/http_server.h"
#include "gs_core/system/processes/process.h"

namespace gs {

/// Listens at a place. Throws Error if the port is taken, or if the host is empty or no address of
/// this machine.
Descriptor listen_at(const HttpPlace& place);

/// The port of a socket that listens.
int port_of(int socket);

/// The next connection that waits, with the peer's address in digits; a negative one if there is
/// none. It does not wait, and no child process inherits it.
Descriptor accept_from(int socket, std::string& address);

}  // namespace gs
