// SPDX-License-Identifier: Apache-2.0
// The layout of --help: CLI11's two columns, with long lines wrapped.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace gs {

/// The width of the terminal at standard output, from 50 to 100 columns; 100 if it is no terminal.
std::size_t help_width();

/// The text in lines of at most `width` columns, broken at spaces, or behind a comma or bar in
/// words that are too long. Each line but the first is indented by `indent` spaces; the first
/// begins in column `start`.
std::string wrapped(const std::string& text, std::size_t start, std::size_t indent,
                    std::size_t width);

class HelpFormat final : public CLI::Formatter {
 public:
  explicit HelpFormat(std::size_t width) : width_(width) {}
  std::string make_option(const CLI::Option* option, bool is_positional) const override;
  std::string make_subcommand(const CLI::App* verb) const override;
  std::string make_description(const CLI::App* app) const override;

 private:
  std::string row(const std::string& name, const std::string& text) const;
  std::size_t width_;
};

}  // namespace gs
