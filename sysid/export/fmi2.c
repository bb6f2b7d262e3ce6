
/* FMI 2.0: the functions by the names and arguments of the standard (https://fmi-standard.org, 2.0.5). */
typedef void (*Log)(void *environment, const char *name, int status, const char *category, const char *message, ...);
typedef struct {
    Log log;
    void *(*allocate)(size_t n, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, int status);
    void *environment;
} Callbacks;
typedef struct {
    int again, terminate, nominals, values, has_next;
    double next;
} EventInfo;

static int report(const Instance *instance, int status, const char *message)
{
    const Log log = (Log)instance->log;
    const char *category = status == ERROR ? "logStatusError" : "logStatusDiscard";
    if (log) log(instance->environment, instance->name, status, category, "%s", message);
    return status;
}

EXPORT const char *FMI(GetTypesPlatform)(void)
{
    return "default";
}

EXPORT const char *FMI(GetVersion)(void)
{
    return "2.0";
}

EXPORT int FMI(SetDebugLogging)(Instance *i, int on, size_t n, const char *const categories[])
{
    return OK;
}

EXPORT Instance *FMI(Instantiate)(const char *name, int type, const char *token, const char *resources,
                                  const Callbacks *callbacks, int visible, int logging)
{
    if (!callbacks) return NULL;
    return instance_of(name, token, type == 0, callbacks->environment, (Callback)callbacks->log);
}

EXPORT int FMI(SetupExperiment)(Instance *i, int has_tolerance, double tolerance, double start, int has_stop,
                                double stop)
{
    start_at(i, start);
    return OK;
}

EXPORT int FMI(GetReal)(Instance *i, const uint32_t *references, size_t n, double *values)
{
    return get(i, references, n, values);
}

EXPORT int FMI(SetReal)(Instance *i, const uint32_t *references, size_t n, const double *values)
{
    return set(i, references, n, values);
}

EXPORT int FMI(DoStep)(Instance *i, double from, double h, int no_return)
{
    return advance(i, from, h);
}

EXPORT int FMI(NewDiscreteStates)(Instance *i, EventInfo *event)
{
    tick(&i->run);
    memset(event, 0, sizeof *event);
    event->has_next = 1;
    event->next = due(&i->run);
    return OK;
}

EXPORT int FMI(CompletedIntegratorStep)(Instance *i, int no_return, int *event, int *terminate)
{
    *event = *terminate = 0;
    return OK;
}

MODE(EnterInitializationMode)
MODE(CancelStep)

EMPTY(GetDerivatives, double)

/* Variables of other types. */
#define TYPE(name, type) \
    EXPORT int FMI(Get##name)(Instance *i, const uint32_t *references, size_t n, type *values) \
    { \
        return none(i, n); \
    } \
    EXPORT int FMI(Set##name)(Instance *i, const uint32_t *references, size_t n, const type *values) \
    { \
        return none(i, n); \
    }
TYPE(Integer, int)
TYPE(Boolean, int)
TYPE(String, char *)

LACKS(GetDirectionalDerivative, const uint32_t *a, size_t n, const uint32_t *b, size_t m, const double *s, double *d)
LACKS(SetRealInputDerivatives, const uint32_t *r, size_t n, const int *o, const double *v)
LACKS(GetRealOutputDerivatives, const uint32_t *r, size_t n, const int *o, double *v)
LACKS(GetStatus, int kind, int *v)
LACKS(GetIntegerStatus, int kind, int *v)
LACKS(GetStringStatus, int kind, const char **v)

EXPORT int FMI(GetRealStatus)(Instance *i, int kind, double *value)
{
    /* the time of the last step that was taken is the only one of this type */
    *value = i->run.time;
    return OK;
}

EXPORT int FMI(GetBooleanStatus)(Instance *i, int kind, int *value)
{
    /* whether the model wants to end */
    *value = 0;
    return OK;
}
