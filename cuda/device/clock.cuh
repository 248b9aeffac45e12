// SPDX-License-Identifier: Apache-2.0
// The clock of the multiprocessors, for benchmarks.
#pragma once

namespace gs {
class Memory;
}

namespace gs::cuda {

class Context;

/// Cycles of a multiprocessor in a microsecond while all of them are busy: 20 milliseconds of
/// arithmetic. Waits for the device.
double clock_mhz(Context& context, Memory& memory);

}  // namespace gs::cuda
