// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/program.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cctype>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <memory>
#include <new>
#include <system_error>

#include "apps/cli/bind_options.h"
#include "apps/cli/foreign_habits.h"
#include "apps/cli/help.h"
#include "apps/cli/run_verb.h"
#include "apps/cli/self_doc.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/progress_bar.h"
#include "gs_app/run/provenance.h"
#include "gs_app/run/text.h"
#include "gs_core/config/text/nearest_word.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/processes/signals.h"
#include "gs_core/system/text/plain_message.h"

namespace gs {
namespace {

constexpr int kInternalError = 1;

// With --progress json the last line is {"event": "error", ...}, or "stopped" after a signal.
int tell(const char* event, const std::string& message, int code) {
  write_progress_json({{"event", event}, {"text", message}, {"exit_code", code}});
  return code;
}

int fail(const std::string& message, int code) {
  if (writes_json_events()) return tell("error", message, code);
  const std::string error = in_color(detail::LogLevel::error, "error:", stderr_has_color());
  const std::string text = wrapped_for_stderr(message, std::string_view("error: ").size());
  std::fprintf(stderr, "%s %s\n", error.c_str(), text.c_str());
  return code;
}

// The verb that was given, such as `diff` of `config diff`, or the program itself.
const CLI::App& active(const CLI::App& program) {
  const auto verbs = program.get_subcommands();
  return verbs.empty() ? program : active(*verbs.front());
}

// As it is written: "gemsplat config diff".
std::string full_name(const CLI::App& app) {
  const CLI::App* parent = app.get_parent();
  return (parent ? full_name(*parent) + " " : "") + app.get_name();
}

// "; did you mean --eval?" for an argument that is near to a flag or verb, else nothing.
std::string suggestion(const CLI::App& app, const std::string& argument) {
  std::vector<std::string> known;
  for (const CLI::App* at = &app; at; at = at->get_fallthrough() ? at->get_parent() : nullptr)
    for (const CLI::Option* option : at->get_options())
      for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
  for (const CLI::App* verb : app.get_subcommands({})) known.push_back(verb->get_name());
  const std::string nearest = nearest_word(argument.substr(0, argument.find('=')), known);
  return nearest.empty() ? "" : "; did you mean " + nearest + "?";
}

// "MODEL is missing: a run's folder, or a PLY": the first argument that the verb needs and did not get.
std::string missing_argument(const CLI::App& app) {
  for (const CLI::Option* option : app.get_options()) {
    if (!option->get_required() || option->count() > 0) continue;
    std::string name = option->get_name();
    if (option->get_positional()) std::transform(name.begin(), name.end(), name.begin(), ::toupper);
    return name + " is missing: " + option->get_description();
  }
  return "";
}

// Whether a shell has made many arguments of `photos/*.jpg`.
bool is_one_of_many_photos(const CLI::App& app, const std::string& argument) {
  const std::string& verb = app.get_name();
  return (verb == "reconstruct" || verb == "train") && is_picture(argument) &&
         std::filesystem::exists(argument);
}

int fail_to_parse(const CLI::App& program, const CLI::ParseError& error) {
  const CLI::App& app = active(program);
  std::string message = error.what();
  if (dynamic_cast<const CLI::RequiredError*>(&error)) {
    if (&app == &program) message = "a command is missing, such as train or view";
    if (const std::string missing = missing_argument(app); !missing.empty()) message = missing;
  }
  if (const std::vector<std::string> extra = program.remaining(true); !extra.empty()) {
    const std::string own = own_flag(app.get_name(), extra.front());
    const bool names_verb = &app == &program;
    const bool is_flag = extra.front().starts_with("-");
    message = (is_flag      ? "there is no flag "
               : names_verb ? "there is no command "
                            : full_name(app) + " takes no further argument ") +
              extra.front() +
              (own.empty() ? suggestion(app, extra.front()) : "; here that is " + own);
    if (is_one_of_many_photos(app, extra.front()))
      message += ": name the folder that holds the photos, " +
                 shell_word((std::filesystem::absolute(extra.front()).parent_path() / "").string());
  }
  return fail(printable(message) + "\n`" + full_name(app) + " --help` shows what there is",
              int(ExitCode::usage));
}

// What to do where memory runs out: only some verbs can do with less.
const char* remedy_of_memory(const CLI::App& program) {
  const std::string verb = active(program).get_name();
  const bool trains = verb == "train" || verb == "experiment" || verb == "bench";
  if (trains) return "lower the resolution (-r) or the number of Gaussians (--max-gaussians)";
  return "close other programs, or use a machine with more memory";
}

int fail_for_memory(const CLI::App& program, const std::string& what) {
  const bool names_remedy = what.find("; ") != what.npos;
  return fail(what + (names_remedy ? "" : std::string("; ") + remedy_of_memory(program)),
              int(ExitCode::out_of_memory));
}

class ProgramHelp final : public CLI::FormatterBase {
 public:
  explicit ProgramHelp(std::vector<Verb> verbs) : verbs_(std::move(verbs)) {}
  std::string make_help(const CLI::App*, std::string, CLI::AppFormatMode) const override {
    return help_of_program(verbs_, help_width());
  }

 private:
  std::vector<Verb> verbs_;
};

int run(int argc, const char* const* argv) {
  CLI::App program("3D Gaussian Splatting: from photos to a trained scene", "gemsplat");
  const std::vector<Verb> all = verbs();
  program.formatter(std::make_shared<ProgramHelp>(all));
  program.set_help_all_flag("--help-all", "");  // verbs inherit it
  program.set_version_flag("-V,--version", describe_build());
  program.require_subcommand(1);
  for (const Verb& verb : all) add_verb(program, verb);
  add_self_doc(program, all);
  std::vector<std::string> arguments =
      without_foreign_habits(normalized_arguments(argc, argv), all);
  std::reverse(arguments.begin(), arguments.end());  // as CLI11 wants them
  try {
    program.parse(arguments);
  } catch (const CLI::Success& request) {  // --help, --version
    return program.exit(request);
  } catch (const CLI::ParseError& error) {
    return fail_to_parse(program, error);
  } catch (const Error& error) {
    if (error.code() != ExitCode::out_of_memory) throw;
    return fail_for_memory(program, error.what());
  } catch (const std::bad_alloc&) {
    return fail_for_memory(program, "out of memory");
  }
  return int(ExitCode::done);
}

// Says why run() failed, in a handler of its exception.
int explain() {
  try {
    throw;
  } catch (const Error& error) {
    if (error.code() == ExitCode::interrupted) {  // it was asked for, and is no error
      if (writes_json_events()) return tell("stopped", error.what(), int(error.code()));
      std::fprintf(stderr, "%s\n", wrapped_for_stderr(error.what()).c_str());
      return int(error.code());
    }
    return fail(error.what(), int(error.code()));
  } catch (const std::filesystem::filesystem_error& error) {
    return fail(plain_message(error) + "; check the path and its permissions",
                int(ExitCode::bad_data));
  } catch (const std::system_error& error) {
    return fail("the system refuses what is needed (" + plain_message(error) +
                    "); close other programs, or raise the limits (ulimit -a)",
                int(ExitCode::bad_data));
  } catch (const std::logic_error& error) {  // those of GS_CHECK ask for a report themselves
    const std::string message = error.what();
    const bool asks = message.find("please report") != message.npos;
    return fail(printable(asks ? message : "internal error: " + message + "; please report this"),
                kInternalError);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    return fail(plain_message(error), int(ExitCode::bad_data));
  }
}

constexpr const char* kNoMemory = "error: out of memory; close other programs\n";

std::atomic<bool> g_memory_ran_out = false;

// What operator new calls where it finds no memory.
[[noreturn]] void note_lack_of_memory() {
  g_memory_ran_out = true;
  throw std::bad_alloc();
}

// Some functions of libraries let no exception out and yet ask for memory, such as CLI11's and those
// that list folders. Where that fails, the C++ runtime calls this. The exception is then mostly the
// current one, but not where g++ 13 or older has compiled the function as a region that must not
// throw.
[[noreturn]] void give_up() {
  bool lacks_memory = false;
  try {
    if (std::current_exception()) throw;
    lacks_memory = g_memory_ran_out && std::uncaught_exceptions() > 0;
  } catch (const std::bad_alloc&) {
    lacks_memory = true;
  } catch (...) {
  }
  if (lacks_memory) {
    std::fputs(kNoMemory, stderr);
    std::_Exit(int(ExitCode::out_of_memory));
  }
  std::fputs("error: internal error: an exception was not caught; please report this\n", stderr);
  std::abort();
}

}  // namespace

int run_program(int argc, const char* const* argv) {
  ignore_file_size_signal();
  std::set_terminate(give_up);
  std::set_new_handler(note_lack_of_memory);
  try {
    try {
      return run(argc, argv);
    } catch (...) {
      return explain();
    }
  } catch (...) {  // no memory is left, not even for words
    std::fputs(kNoMemory, stderr);
    return int(ExitCode::out_of_memory);
  }
}

}  // namespace gs
