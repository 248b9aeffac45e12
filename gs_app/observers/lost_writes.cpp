// SPDX-License-Identifier: Apache-2.0
#include "gs_app/observers/lost_writes.h"

#include <cstdlib>
#include <sstream>

#include "gs_app/run/csv.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/plain_message.h"

namespace gs {

bool LostWrites::attempt(const std::string& what, const std::function<void()>& write) {
  std::string why;
  try {
    write();
    forget(what);
    return true;
  } catch (const Error& error) {
    if (error.code() == ExitCode::out_of_memory) throw;
    why = error.what();
  } catch (const std::filesystem::filesystem_error& error) {
    why = plain_message(error);
  }
  const auto known = [&](const Loss& loss) { return loss.what == what; };
  if (std::erase_if(losses_, known) == 0)  // each only once
    log_warning("{} could not be written: {}; training goes on", what, why);
  losses_.push_back({what, why});
  return false;
}

void LostWrites::forget(const std::string& what) {
  std::erase_if(losses_, [&](const Loss& loss) { return loss.what == what; });
}

void LostWrites::say_again() const {
  for (const Loss& loss : losses_)
    log_warning("{} is missing or incomplete: {}", loss.what, loss.why);
}

GrowingCsv::GrowingCsv(std::filesystem::path file, const std::string& header,
                       const std::string& rows, LostWrites& lost)
    : path_(std::move(file)), header_bytes_(header.size()), text_(header + rows),
      written_(text_.size()), lost_(lost) {
  write_text(path_, text_);
}

void GrowingCsv::add(const std::string& rows) {
  text_ += rows;
  write();
}

void GrowingCsv::cut_after(int step) {
  std::istringstream lines(rows());
  text_.resize(header_bytes_);
  for (std::string line; std::getline(lines, line);)
    if (std::atoi(line.c_str()) <= step) text_ += line + "\n";
  written_ = std::string::npos;  // the file holds other rows
  write();
}

// Appends what is missing, or writes the whole file where it is not as we left it.
void GrowingCsv::write() {
  lost_.attempt(path_.filename().string(), [&] {
    std::error_code error;
    const bool is_as_left = std::filesystem::file_size(path_, error) == written_ && !error;
    try {
      if (is_as_left)
        append_rows(path_, text_.substr(written_));
      else
        write_text(path_, text_);
    } catch (const Error&) {
      if (is_as_left) std::filesystem::resize_file(path_, written_, error);  // no half of a row
      throw;
    }
    written_ = text_.size();
  });
}

}  // namespace gs
