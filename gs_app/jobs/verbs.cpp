// SPDX-License-Identifier: Apache-2.0
#include "gs_app/jobs/verbs.h"

namespace gs {

std::vector<Verb> verbs() {
#define GS_CALL_VERB(name) name##_verb(),
  return {GS_VERBS(GS_CALL_VERB)};
#undef GS_CALL_VERB
}

}  // namespace gs
