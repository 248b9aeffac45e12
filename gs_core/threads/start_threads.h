// SPDX-License-Identifier: Apache-2.0
// Threads for pools. A system with few processes or little address space left, as in containers,
// may refuse some or all of them; a pool goes on with those that started.
#pragma once

#include <functional>
#include <future>
#include <thread>
#include <vector>

namespace gs {

/// Starts up to `count` threads that call `body`, and appends them to `threads`. The first one that
/// the system refuses ends the attempt; a warning says how many there are. Whoever calls this works
/// also with none.
void start_threads(std::vector<std::thread>& threads, int count, const std::function<void()>& body);

/// Runs f() on a thread of its own, whose loops take no other one, or right now where the system gives
/// no thread. The result throws what f() threw, and waits for its end when it goes out of scope.
std::future<void> in_background(std::function<void()> f);

/// A hook for tests in which threads cannot start. It is called before each start of
/// start_threads() and in_background(), and may throw std::system_error as std::thread would. There
/// is one for the whole program; null, the initial value, allows everything.
using ThreadHook = void (*)();
void set_thread_hook(ThreadHook hook);

}  // namespace gs
