/* What both versions of the interface have in common: one run of a sampled model, and its numbers by reference.

   References: 0 is time, then come the inputs, the outputs, the parameters and the states, in the order of the
   structs of the model, which hold doubles only. A sample is due at the start and after every Ts from there.

   Co-simulation: a step takes the samples from its start up to, not with, its end. An output is that of the present
   sample with the present input: it is computed from a copy of the state whenever it is asked for.
   Model exchange: there are no continuous states and no event indicators. Each sample is a time event; the output
   holds in between. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "NAME.h"

#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter" /* the arguments are those of the standard */
#endif
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif

#ifdef FMI3_FUNCTION_PREFIX
#define FMI_JOIN(a, b) a##b
#define FMI_NAME(prefix, name) FMI_JOIN(prefix, name)
#define FMI(name) FMI_NAME(FMI3_FUNCTION_PREFIX, fmi3##name)
#else
#define FMI(name) fmi3##name
#endif

typedef void (*Callback)(void); /* of any type */

enum { OK, WARNING, DISCARD, ERROR }; /* status, as both versions number it */

enum { INPUTS = 1, OUTPUTS = INPUTS + NAME_inputs, PARAMETERS = OUTPUTS + NAME_outputs };
enum { STATES = PARAMETERS + (int)(sizeof(NAME_params) / sizeof(double)) };
enum { END = STATES + (int)(sizeof(NAME_state) / sizeof(double)) };

typedef struct { /* all that a saved state holds */
    double start, time, samples; /* samples taken */
    double u[NAME_inputs], y[NAME_outputs];
    NAME_params p;
    NAME_state s;
    bool running; /* initialised */
} Run;

typedef struct {
    Run run;
    bool exchange; /* model exchange, not co-simulation */
    void *environment;
    Callback log;
    char *name;
} Instance;

static int report(const Instance *instance, int status, const char *message);

static void begin(Run *run)
{
    static const double resting[NAME_inputs] = RESTING;
    memset(run, 0, sizeof *run);
    memcpy(run->u, resting, sizeof resting);
    run->p = NAME_fit;
    NAME_init(&run->s, &run->p);
}

static Instance *instance_of(const char *name, const char *token, bool exchange, void *environment, Callback log)
{
    Instance *instance;
    const size_t length = name ? strlen(name) : 0;
    if (!token || strcmp(token, TOKEN) != 0) return NULL;
    instance = (Instance *)calloc(1, sizeof *instance);
    if (!instance) return NULL;
    instance->name = (char *)calloc(length + 1, 1);
    if (!instance->name) {
        free(instance);
        return NULL;
    }
    if (name) memcpy(instance->name, name, length);
    instance->exchange = exchange;
    instance->environment = environment;
    instance->log = log;
    begin(&instance->run);
    return instance;
}

static void release(Instance *instance)
{
    if (instance) free(instance->name);
    free(instance);
}

static void sample(Run *run, NAME_state *s, double *y)
{
    STEP
}

/* The next sample that is due. */
static double due(const Run *run)
{
    return run->start + run->samples * NAME_Ts;
}

static int get(Instance *instance, const uint32_t *references, size_t n, double *values)
{
    Run *run = &instance->run;
    bool fresh = instance->exchange && run->samples > 0.0;
    for (size_t i = 0; i < n; ++i) {
        const uint32_t r = references[i];
        if (r >= END) return report(instance, ERROR, "a variable was asked for that the model does not have");
        if (r >= OUTPUTS && r < PARAMETERS && !fresh) {
            NAME_state copy = run->s;
            sample(run, &copy, run->y);
            fresh = true;
        }
        if (r < INPUTS) values[i] = run->time;
        else if (r < OUTPUTS) values[i] = run->u[r - INPUTS];
        else if (r < PARAMETERS) values[i] = run->y[r - OUTPUTS];
        else if (r < STATES) values[i] = ((const double *)&run->p)[r - PARAMETERS];
        else values[i] = ((const double *)&run->s)[r - STATES];
    }
    return OK;
}

static int set(Instance *instance, const uint32_t *references, size_t n, const double *values)
{
    Run *run = &instance->run;
    for (size_t i = 0; i < n; ++i) {
        const uint32_t r = references[i];
        if (r >= INPUTS && r < OUTPUTS) run->u[r - INPUTS] = values[i];
        else if (r >= PARAMETERS && r < STATES) ((double *)&run->p)[r - PARAMETERS] = values[i];
        else return report(instance, ERROR, "only inputs and parameters can be set");
    }
    if (!run->running) NAME_init(&run->s, &run->p);
    return OK;
}

/* The samples from the present one up to a time h later; only multiples of Ts are taken. */
static int advance(Instance *instance, double from, double h)
{
    Run *run = &instance->run;
    const double n = floor(h / NAME_Ts + 0.5);
    char text[160];
    if (!(n >= 1.0) || !(fabs(h - n * NAME_Ts) <= 1e-6 * NAME_Ts)) {
        snprintf(text, sizeof text, "a step of %.17g s is not taken; give a multiple of %.17g s", h, NAME_Ts);
        return report(instance, DISCARD, text);
    }
    if (!(fabs(from - run->time) <= 1e-6 * NAME_Ts)) {
        snprintf(text, sizeof text, "a step from %.17g s is not taken; the model is at %.17g s", from, run->time);
        return report(instance, ERROR, text);
    }
    for (double k = 0.0; k < n; k += 1.0) sample(run, &run->s, run->y);
    run->samples += n;
    run->time = from + h;
    return OK;
}

/* The sample that is due at the present time, if one is: an event of model exchange. */
static void tick(Run *run)
{
    if (run->time < due(run) - 1e-6 * NAME_Ts) return;
    sample(run, &run->s, run->y);
    run->samples += 1.0;
}

static void start_at(Instance *instance, double time)
{
    instance->run.start = instance->run.time = time;
}

/* Functions that both versions have. */
EXPORT void FMI(FreeInstance)(Instance *i)
{
    release(i);
}

EXPORT int FMI(ExitInitializationMode)(Instance *i)
{
    i->run.running = true;
    return OK;
}

EXPORT int FMI(Reset)(Instance *i)
{
    begin(&i->run);
    return OK;
}

EXPORT int FMI(SetTime)(Instance *i, double time)
{
    i->run.time = time;
    return OK;
}

EXPORT int FMI(GetFMUState)(Instance *i, void **kept)
{
    if (!*kept) *kept = calloc(1, sizeof(Run));
    if (!*kept) return report(i, ERROR, "there is no memory left");
    memcpy(*kept, &i->run, sizeof(Run));
    return OK;
}

EXPORT int FMI(SetFMUState)(Instance *i, void *kept)
{
    memcpy(&i->run, kept, sizeof(Run));
    return OK;
}

EXPORT int FMI(FreeFMUState)(Instance *i, void **kept)
{
    free(*kept);
    *kept = NULL;
    return OK;
}

EXPORT int FMI(SerializedFMUStateSize)(Instance *i, void *kept, size_t *n)
{
    *n = sizeof(Run);
    return OK;
}

EXPORT int FMI(SerializeFMUState)(Instance *i, void *kept, uint8_t *bytes, size_t n)
{
    if (n < sizeof(Run)) return report(i, ERROR, "the place for the state is too small");
    memcpy(bytes, kept, sizeof(Run));
    return OK;
}

EXPORT int FMI(DeserializeFMUState)(Instance *i, const uint8_t *bytes, size_t n, void **kept)
{
    if (n != sizeof(Run)) return report(i, ERROR, "these bytes are no state of this model");
    if (!*kept) *kept = calloc(1, sizeof(Run));
    if (!*kept) return report(i, ERROR, "there is no memory left");
    memcpy(*kept, bytes, sizeof(Run));
    return OK;
}

/* A change of mode, with nothing to do. */
#define MODE(name) \
    EXPORT int FMI(name)(Instance *i) \
    { \
        return OK; \
    }
MODE(EnterEventMode)
MODE(EnterContinuousTimeMode)
MODE(Terminate)

/* Vectors of no continuous states and no event indicators. */
#define EMPTY(name, type) \
    EXPORT int FMI(name)(Instance *i, type *values, size_t n) \
    { \
        return n == 0 ? OK : report(i, ERROR, "the model has no continuous states and no event indicators"); \
    }
EMPTY(SetContinuousStates, const double)
EMPTY(GetEventIndicators, double)
EMPTY(GetContinuousStates, double)
EMPTY(GetNominalsOfContinuousStates, double)

static int none(const Instance *i, size_t n)
{
    return n == 0 ? OK : report(i, ERROR, "all variables of the model are real numbers");
}

/* What the model description does not offer: the arguments are not looked at. */
#define LACKS(name, ...) \
    EXPORT int FMI(name)(Instance *i, __VA_ARGS__) \
    { \
        return report(i, ERROR, "fmi3" #name " is not offered by the model"); \
    }
