// SPDX-License-Identifier: Apache-2.0
// Options that verbs share.
#pragma once

#include <optional>
#include <string>

#include "gs_app/jobs/parts/option.h"
#include "gs_app/view/http/http_server.h"

namespace gs {

/// What verbs that read any model say of their argument.
inline constexpr const char* kModelHelp =
    "a model of any trainer (.ply, .spz, .sog, .glb, .rad, .npz, .splat or .gs4d, or a folder "
    "with meta.json), or a run's folder";

/// -c, --set, --device, --threads, -q, -v: what every verb that computes takes.
void general_options(OptionList& option);

/// Which model of a run.
struct ModelChoice {
  std::optional<int> step;
};
void model_options(OptionList& option, ModelChoice& choice);

/// --time: a moment of Gaussians in space and time.
Option& time_option(OptionList& option, std::optional<double>& time, const std::string& meaning);

/// The scene (`scene_names`: its option's names), --images, -r, --test-every: all that poses and
/// sizes of its cameras depend on.
void camera_options(OptionList& option, const std::string& scene_names);
/// camera_options() with --data for the scene, or --cameras instead; `otherwise` says what is taken
/// where neither is given.
void given_camera_options(OptionList& option, std::string& cameras, const std::string& otherwise);
/// --masks, --mask-mode, --invert-masks.
void mask_options(OptionList& option);
/// Both, and where decoded photos are kept: for verbs that use all photos.
void dataset_options(OptionList& option, const std::string& scene_names);

/// --background, -w, --antialiased, --blend-rule, --sh-degree. If the SH degree is that of a file
/// to write, `sh_degree_meaning` says so.
void render_options(OptionList& option, const std::string& sh_degree_meaning = {});

/// Whether the browser is opened.
void open_option(OptionList& option, std::optional<bool>& open);
Option& port_option(OptionList& option, HttpPlace& place, const std::string& prefix,
                    const std::string& heading);
/// Where a server listens: HOST and PORT, behind `prefix` ("--viewer-").
void http_options(OptionList& option, HttpPlace& place, const std::string& prefix,
                  const std::string& heading);

}  // namespace gs
