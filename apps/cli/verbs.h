// SPDX-License-Identifier: Apache-2.0
// The verbs of the program. Each function adds one verb to the command line, with its flags and its
// work. main() catches the errors of verbs and shows them.
#pragma once

namespace CLI {
class App;
}

namespace gs {

void add_reconstruct(CLI::App& program);
void add_undistort(CLI::App& program);
void add_doctor(CLI::App& program);
void add_georef(CLI::App& program);
void add_train(CLI::App& program);
void add_config(CLI::App& program);
void add_experiment(CLI::App& program);
void add_partition(CLI::App& program);
void add_report(CLI::App& program);
void add_eval(CLI::App& program);
void add_render(CLI::App& program);
void add_view(CLI::App& program);
void add_edit(CLI::App& program);
void add_export(CLI::App& program);
void add_info(CLI::App& program);
void add_bench(CLI::App& program);
void add_selftest(CLI::App& program);
void add_self_doc(CLI::App& program);

}  // namespace gs
